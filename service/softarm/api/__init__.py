"""What travels over zenoh: keys, messages, verbs, and the page generated from them."""
