"""The operator page: a zenoh client that shows one arm in the browser, with a dead-man's hold."""
