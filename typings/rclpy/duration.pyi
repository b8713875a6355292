class Duration:
    nanoseconds: int

Infinite: Duration
