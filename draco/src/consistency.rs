//! Which closures to believe: the tests of `draco-consistency` by name.
