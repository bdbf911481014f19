"""Which sightings and which structure of the camera the data support."""
