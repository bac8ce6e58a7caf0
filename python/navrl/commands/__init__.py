"""What the commands do once their options are read, one file each; `navrl.cli` says what may be typed."""
