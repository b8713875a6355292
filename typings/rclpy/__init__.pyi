"""The part of rclpy that SOTER uses: it has types of its own, but is not there wherever SOTER's are checked."""

from collections.abc import Sequence

from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

def init(
    *,
    args: Sequence[str] | None = ...,
    context: Context | None = ...,
    domain_id: int | None = ...,
    signal_handler_options: SignalHandlerOptions | None = ...,
) -> None: ...
def ok(*, context: Context | None = ...) -> bool: ...
def shutdown(*, context: Context | None = ...) -> None: ...
def try_shutdown(*, context: Context | None = ...) -> None: ...
def create_node(node_name: str, *, context: Context | None = ..., namespace: str | None = ...) -> Node: ...
def spin(node: Node) -> None: ...
