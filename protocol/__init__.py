"""What travels: key expressions, messages, the wireframe codec, sessions."""
