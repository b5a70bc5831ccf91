//! Keyframe folders on disk.
