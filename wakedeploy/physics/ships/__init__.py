"""Ships that pass each other: forces by slender-body theory and by vortices in shallow water."""
