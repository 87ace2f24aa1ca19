//! Units as plain aliases with names, so that a signature says what it is measured in.

/// Time, s.
pub type Seconds = f64;
/// Frequency, Hz.
pub type Hertz = f64;
/// Angle, rad.
pub type Radians = f64;
/// Length, m.
pub type Metres = f64;
/// Force, N.
pub type Newtons = f64;
