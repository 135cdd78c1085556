"""The recording and its noise, beside what the simulator says that the sensors should have measured."""
