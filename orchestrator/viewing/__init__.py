"""What makes recordings look like something in the viewers people have."""
