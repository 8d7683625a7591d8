"""What runs on recordings: estimation over time, and the inputs that offline commands share."""
