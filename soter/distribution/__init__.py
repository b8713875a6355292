"""One mission on several hosts: the bus between its processes, and what they tell each other."""
