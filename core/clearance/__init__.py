"""From flown amplitudes to the next one: identification, sensors, clearance."""
