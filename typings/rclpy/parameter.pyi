from typing import Any

class Parameter:
    value: Any
    def __init__(self, name: str, *, value: Any = ...) -> None: ...
