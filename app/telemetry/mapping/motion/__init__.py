"""What the motion of the aircraft says of a mapping: units, signs, gravity and bias."""
