"""The proof of the diagnosis: sealed trials, alternatives, forces, cost."""
