"""What sees what on a depth map: shadows, sky and exchange of light, in slices through pixels."""
