//! What the records of a database are made of.

/// Where records lie (reference 5.8.13).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Key {
    /// (s, t) on a surface: two numbers.
    Surface,
    /// A point: three numbers.
    Point,
    /// A point and a unit normal: six numbers.
    Oriented,
}

impl Key {
    /// Numbers of a position: 2 or 3.
    pub const fn dimensions(self) -> usize {
        match self {
            Self::Surface => 2,
            Self::Point | Self::Oriented => 3,
        }
    }

    /// Numbers of a key: 2, 3 or 6.
    pub const fn numbers(self) -> usize {
        match self {
            Self::Surface => 2,
            Self::Point => 3,
            Self::Oriented => 6,
        }
    }

    /// In words, for messages.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Surface => "(s, t)",
            Self::Point => "points",
            Self::Oriented => "points and normals",
        }
    }
}

/// What records hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Value {
    /// One number.
    Float,
    /// Three, as all that follow.
    Color,
    /// A position.
    Point,
    /// A direction.
    Vector,
    /// A normal.
    Normal,
    /// Indirect light where records of a light cache lie: a color, then how it changes (`indirect ()`).
    Irradiance,
    /// Occlusion there: a float, then the mean open direction and how occlusion changes (`occlusion ()`).
    Occlusion,
}

impl Value {
    /// All of them, by their number in files.
    pub const ALL: [Self; 7] = [
        Self::Float,
        Self::Color,
        Self::Point,
        Self::Vector,
        Self::Normal,
        Self::Irradiance,
        Self::Occlusion,
    ];

    /// Numbers of a value.
    ///
    /// Irradiance: the color, three gradients over places (of red, green and blue), three over normals, and the second
    /// derivatives xx, yy, zz, xy, xz and yz of the mean of the channels. Occlusion: the blocked share, the mean open
    /// direction, a gradient over places, one over normals, and second derivatives in the same order. All in "common" space.
    pub const fn numbers(self) -> usize {
        match self {
            Self::Float => 1,
            Self::Irradiance => 27,
            Self::Occlusion => 16,
            _ => 3,
        }
    }

    /// The first numbers of a value, 1 or 3, which are what `spatialdbquery` gives.
    pub const fn components(self) -> usize {
        match self {
            Self::Float | Self::Occlusion => 1,
            _ => 3,
        }
    }

    /// The type's name in the shading language, or what a light cache keeps.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::Color => "color",
            Self::Point => "point",
            Self::Vector => "vector",
            Self::Normal => "normal",
            Self::Irradiance => "irradiance",
            Self::Occlusion => "occlusion",
        }
    }
}

/// What all records of a database are: a key, then a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Schema {
    /// Where they lie.
    pub key: Key,
    /// What they hold.
    pub value: Value,
}

impl Schema {
    /// Numbers of a record: the key's, then the value's.
    pub const fn numbers(self) -> usize {
        self.key.numbers() + self.value.numbers()
    }

    /// In words: "color by points".
    pub fn words(self) -> String {
        format!("{} by {}", self.value.word(), self.key.word())
    }
}
