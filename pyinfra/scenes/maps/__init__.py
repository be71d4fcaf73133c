"""Site folders from OpenDRIVE, OpenStreetMap and SUMO maps, with meshes and traffic."""
