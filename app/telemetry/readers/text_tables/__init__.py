"""Tables of text: how they are laid out, and how their rows become numbers."""
