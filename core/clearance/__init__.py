"""What a flown amplitude says about the next one: identification, sensors, clearance."""
