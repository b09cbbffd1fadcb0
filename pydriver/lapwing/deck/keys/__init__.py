"""The keys of the studies, one file each: nothing else describes a study's inputs."""
