//! One robot as a state machine without clock, thread, file or socket.
