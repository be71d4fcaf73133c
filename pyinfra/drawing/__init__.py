"""Pictures of frames, scenes and vehicles."""
