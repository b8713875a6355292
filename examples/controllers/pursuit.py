"""Pure pursuit: a controller that follows a loop of points, and says how fast to go and to turn."""

from math import atan2, cos, hypot, remainder, sin, tau

from pydantic import BaseModel, Field

from soter import Velocity, VelocityController
from soter.sdk import RobotState


class Pursuit(VelocityController):
    """Steers for the point of its loop that it is to pass next. There is one for each robot."""

    class Options(BaseModel, extra="forbid"):
        """The loop, in metres; how near a point is passed; and how fast."""

        loop: list[tuple[float, float]] = Field(min_length=2)
        near_m: float = Field(default=0.3, gt=0.0)
        speed_m_s: float = Field(default=0.2, gt=0.0)

    options: Options

    next = 0

    def velocity(self, own: RobotState, now_s: float) -> Velocity:
        loop, near_m, speed_m_s = self.options.loop, self.options.near_m, self.options.speed_m_s
        x_m, y_m = loop[self.next % len(loop)]
        if hypot(x_m - own.x_m, y_m - own.y_m) < near_m:
            self.next += 1
            x_m, y_m = loop[self.next % len(loop)]
        aside_rad = remainder(atan2(y_m - own.y_m, x_m - own.x_m) - own.heading_rad, tau)
        if abs(aside_rad) > 1.0:
            return Velocity(0.0, 2.0 * aside_rad)
        return Velocity(speed_m_s * cos(aside_rad), 2.0 * speed_m_s / near_m * sin(aside_rad))
