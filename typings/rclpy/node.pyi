from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

class Publisher:
    def publish(self, msg: Any) -> None: ...

class Logger:
    def info(self, message: str) -> bool: ...
    def warning(self, message: str) -> bool: ...

class EndpointInfo:
    node_name: str
    node_namespace: str
    topic_type: str
    qos_profile: QoSProfile

class Node:
    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = ...,
        namespace: str | None = ...,
        use_global_arguments: bool = ...,
        enable_rosout: bool = ...,
        start_parameter_services: bool = ...,
        parameter_overrides: list[Parameter] | None = ...,
    ) -> None: ...
    def create_publisher(self, msg_type: Any, topic: str, qos_profile: QoSProfile | int) -> Publisher: ...
    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        qos_profile: QoSProfile | int,
        *,
        raw: bool = ...,
    ) -> object: ...
    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], None], *, clock: Clock | None = ...
    ) -> object: ...
    def declare_parameter(self, name: str, value: Any) -> Parameter: ...
    def destroy_node(self) -> None: ...
    def get_clock(self) -> Clock: ...
    def get_logger(self) -> Logger: ...
    def get_name(self) -> str: ...
    def get_namespace(self) -> str: ...
    def get_publishers_info_by_topic(self, topic_name: str) -> Sequence[EndpointInfo]: ...
    def get_subscriptions_info_by_topic(self, topic_name: str) -> Sequence[EndpointInfo]: ...
