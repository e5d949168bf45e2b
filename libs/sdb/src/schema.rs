//! The schema of the records of a database.

/// The positions of records (reference 5.8.13).
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
    /// The number of coordinates of a position: 2 or 3.
    pub const fn dimensions(self) -> usize {
        match self {
            Self::Surface => 2,
            Self::Point | Self::Oriented => 3,
        }
    }

    /// The number of floats of a key: 2, 3 or 6.
    pub const fn numbers(self) -> usize {
        match self {
            Self::Surface => 2,
            Self::Point => 3,
            Self::Oriented => 6,
        }
    }

    /// Returns a description for messages.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Surface => "(s, t)",
            Self::Point => "points",
            Self::Oriented => "points and normals",
        }
    }
}

/// The values of records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Value {
    /// One number.
    Float,
    /// Three numbers, like the following types.
    Color,
    /// A position.
    Point,
    /// A direction.
    Vector,
    /// A normal.
    Normal,
    /// Indirect light at the records of an irradiance cache: a color, then its derivatives (`indirect ()`).
    Irradiance,
    /// Occlusion at such records: a float, then the mean open direction and the derivatives of occlusion
    /// (`occlusion ()`).
    Occlusion,
}

impl Value {
    /// All values, by their number in files.
    pub const ALL: [Self; 7] = [
        Self::Float,
        Self::Color,
        Self::Point,
        Self::Vector,
        Self::Normal,
        Self::Irradiance,
        Self::Occlusion,
    ];

    /// The number of floats of a value.
    ///
    /// Irradiance has the color, three translational gradients (of red, green and blue), three rotational gradients,
    /// and the second derivatives xx, yy, zz, xy, xz and yz of the mean of the channels. Occlusion has the blocked
    /// fraction, the mean open direction, a translational gradient, a rotational gradient, and the second derivatives
    /// in the same order. All are in "common" space.
    pub const fn numbers(self) -> usize {
        match self {
            Self::Float => 1,
            Self::Irradiance => 27,
            Self::Occlusion => 16,
            _ => 3,
        }
    }

    /// The number of the first floats of a value, 1 or 3, which `spatialdbquery` returns.
    pub const fn components(self) -> usize {
        match self {
            Self::Float | Self::Occlusion => 1,
            _ => 3,
        }
    }

    /// Returns the type's name in the shading language, or the kind of cached data.
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

/// The schema of all records of a database: a key, then a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Schema {
    /// The key.
    pub key: Key,
    /// The value.
    pub value: Value,
}

impl Schema {
    /// The number of floats of a record: those of the key, then those of the value.
    pub const fn numbers(self) -> usize {
        self.key.numbers() + self.value.numbers()
    }

    /// Returns a description, such as "color by points".
    pub fn words(self) -> String {
        format!("{} by {}", self.value.word(), self.key.word())
    }
}
