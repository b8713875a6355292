"""Between processes: the ports of a mission beside its supervisor, and the processes of a distributed mission."""
