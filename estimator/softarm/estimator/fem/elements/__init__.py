"""Elements and force terms: solids, chambers, fibres, and their materials."""
