"""What commands and the daemon share: the error of work that failed, and rods fitted to a specimen."""
