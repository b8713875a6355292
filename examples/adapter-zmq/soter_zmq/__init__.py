"""Robots that speak JSON over ZeroMQ, simulated (`soter_zmq.robot`), and the adapter that gives them to SOTER."""
