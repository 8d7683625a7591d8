"""Effects outside the diagnosis's vocabulary: what it must call unknown."""
