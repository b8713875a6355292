from std_msgs.msg import Header

class Vector3:
    x: float
    y: float
    z: float
    def __init__(self, *, x: float = ..., y: float = ..., z: float = ...) -> None: ...

class Quaternion:
    x: float
    y: float
    z: float
    w: float

class Point:
    x: float
    y: float
    z: float

class Pose:
    position: Point
    orientation: Quaternion

class PoseWithCovariance:
    pose: Pose

class Twist:
    linear: Vector3
    angular: Vector3
    def __init__(self, *, linear: Vector3 = ..., angular: Vector3 = ...) -> None: ...

class TwistWithCovariance:
    twist: Twist

class TwistStamped:
    header: Header
    twist: Twist
