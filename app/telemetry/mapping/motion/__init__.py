"""Check a mapping against the motion of the aircraft: units, signs, gravity and bias."""
