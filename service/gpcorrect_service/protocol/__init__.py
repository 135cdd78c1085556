"""What planner and server say to each other: messages, encodings, errors, settings and zenoh sessions."""
