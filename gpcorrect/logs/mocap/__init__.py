"""Motion capture: a file each format; all yield a Take, of which one body or the markers on it are the tool."""
