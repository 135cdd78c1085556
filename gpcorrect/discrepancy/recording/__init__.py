"""The recording and its noise, seen beside what the simulator says that the sensors should have shown."""
