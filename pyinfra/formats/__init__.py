"""Readers and writers of files: KITTI folders, PCD, PLY, CSV, YAML."""
