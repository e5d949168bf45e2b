//! The random numbers of the passes of an image, and what its noise comes from.

/// A use of random numbers, whose part in the noise of an image can be measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseSource {
    /// The positions of samples in pixels: edges, textures and shading that vary within a pixel.
    Edges,
    /// The times of samples and rays.
    Motion,
    /// The points on the lens.
    Lens,
    /// Points on area lights, directions of broad ones, and rays of soft shadows.
    Lights,
    /// Directions drawn from environment maps.
    Environment,
    /// Rays of glossy reflections, and those of `gather` loops.
    Rays,
    /// Rays of `occlusion ()`.
    Occlusion,
    /// Rays of `indirect ()`.
    Indirect,
}

impl NoiseSource {
    /// All sources, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Edges,
        Self::Motion,
        Self::Lens,
        Self::Lights,
        Self::Environment,
        Self::Rays,
        Self::Occlusion,
        Self::Indirect,
    ];

    /// Returns the name of the source for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Edges => "edges",
            Self::Motion => "motion",
            Self::Lens => "lens",
            Self::Lights => "lights",
            Self::Environment => "environment",
            Self::Rays => "rays",
            Self::Occlusion => "occlusion",
            Self::Indirect => "indirect",
        }
    }
}

/// The random numbers of a pass of an image that is the sum of passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassNumbers {
    /// The number of the pass. Those of pass 0 are those of a frame of its own.
    pub pass: u32,
    /// The source that has other random numbers than the pass, while all other sources have those of the pass.
    pub varied: Option<NoiseSource>,
}

impl PassNumbers {
    /// The number that replaces that of the pass for the source that is varied.
    const VARIED: u32 = u32::MAX;

    /// Returns the numbers of a pass.
    pub fn of(pass: u32) -> Self {
        Self { pass, varied: None }
    }

    /// Returns the number that the seeds of a source are combined with; 0 for those of a frame of its own.
    pub fn number(self, source: NoiseSource) -> u32 {
        if self.varied == Some(source) { Self::VARIED } else { self.pass }
    }
}
