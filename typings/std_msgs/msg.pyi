from builtin_interfaces.msg import Time

class Header:
    stamp: Time
    frame_id: str

class String:
    data: str
    def __init__(self, *, data: str = ...) -> None: ...

class Float64:
    data: float
    def __init__(self, *, data: float = ...) -> None: ...
