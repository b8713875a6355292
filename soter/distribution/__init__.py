"""One mission on several hosts: the bus between its processes, and their messages."""
