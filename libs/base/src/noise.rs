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

/// A set of noise sources.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoiseSources(u32);

impl NoiseSources {
    /// The samples of pixels. The others are those of shading.
    pub const OF_PIXELS: Self = Self(
        1 << NoiseSource::Edges as u32 | 1 << NoiseSource::Motion as u32 | 1 << NoiseSource::Lens as u32,
    );

    /// Returns the set of one source.
    pub fn of(source: NoiseSource) -> Self {
        Self(1 << source as u32)
    }

    /// Returns a set from its bits.
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Returns a bit for each source, the lowest for the first of [`NoiseSource::ALL`].
    pub fn bits(self) -> u32 {
        self.0
    }

    /// True when a source is in the set.
    pub fn contains(self, source: NoiseSource) -> bool {
        self.0 >> source as u32 & 1 != 0
    }
}

/// The random numbers of a pass of an image that is the sum of passes.
///
/// There are two sets of sequences, which are independent of each other. Even passes draw from one, odd passes from the
/// other, and each pass continues where the one before stopped ([`Sequence`](crate::sample::Sequence)). So many passes
/// are spread as evenly as one with many samples, and the difference between both halves shows the noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassNumbers {
    /// The set of sequences. The set 0 is that of a frame of its own.
    pub set: u32,
    /// The round that draws from the set.
    pub round: u32,
    /// The sources that have other random numbers than the pass, while all other sources have those of the pass.
    pub varied: NoiseSources,
}

impl PassNumbers {
    /// The number that replaces the set for sources that are varied.
    const VARIED: u32 = u32::MAX;

    /// Returns the numbers of a pass of an image. Those of pass 0 are those of a frame of its own.
    pub fn of(pass: u32) -> Self {
        Self { set: pass % 2, round: pass / 2, varied: NoiseSources::default() }
    }

    /// Returns the numbers of a pass that is independent of all others with such numbers. The first two are those of
    /// an image.
    pub fn alone(pass: u32) -> Self {
        Self { set: pass, round: 0, varied: NoiseSources::default() }
    }

    /// Returns the number that the seeds of a source are combined with; 0 for those of a frame of its own.
    pub fn number(self, source: NoiseSource) -> u32 {
        if self.varied.contains(source) { Self::VARIED } else { self.set }
    }
}
