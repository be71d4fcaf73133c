"""Site folders from OpenDRIVE, OpenStreetMap and SUMO maps, meshes and traffic."""
