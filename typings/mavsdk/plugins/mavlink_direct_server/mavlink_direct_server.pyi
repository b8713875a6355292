from collections.abc import Callable
from typing import Any

class ServerComponent: ...
class MavlinkDirectServerError(Exception): ...

class MavlinkMessage:
    message_name: str
    system_id: int
    component_id: int
    fields_json: str
    def __init__(
        self,
        message_name: str,
        system_id: int,
        component_id: int,
        target_system_id: int,
        target_component_id: int,
        fields_json: str,
    ) -> None: ...

class MavlinkDirectServer:
    def __init__(self, server_component: ServerComponent) -> None: ...
    def send_message(self, message: MavlinkMessage) -> object: ...
    def subscribe_message(self, message_name: str, callback: Callable[[MavlinkMessage, Any], None]) -> object: ...
