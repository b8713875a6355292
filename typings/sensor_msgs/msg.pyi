from std_msgs.msg import Header

class BatteryState:
    header: Header
    percentage: float
    present: bool
