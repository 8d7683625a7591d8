"""The fake arm: what drives it, what it shows, and the dynamics between the two."""
