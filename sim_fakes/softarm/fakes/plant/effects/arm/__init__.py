"""Effects inside the arm, all of the diagnosis's vocabulary."""
