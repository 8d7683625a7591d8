"""Effects of the valves and of the sensors, as filters of their signals."""
