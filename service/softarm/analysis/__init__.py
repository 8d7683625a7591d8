"""Work on recordings: estimates, plots and diagnoses."""
