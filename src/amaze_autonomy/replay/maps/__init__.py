"""Topic maps of known recordings, one YAML file each; a package so that every installation brings them along."""
