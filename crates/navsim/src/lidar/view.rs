//! The lidar's frame.

/// Where the lidar is: position (m) and heading as cosine and sine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub x: f32,
    pub y: f32,
    pub cos: f32,
    pub sin: f32,
}

impl View {
    /// The vector (x, y) of the world in the lidar's frame.
    #[inline(always)]
    pub fn turn(&self, x: f32, y: f32) -> (f32, f32) {
        (self.cos * x + self.sin * y, self.cos * y - self.sin * x)
    }
}
