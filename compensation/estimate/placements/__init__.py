"""Where the artefact stood: poses and free targets, fitted or eliminated."""
