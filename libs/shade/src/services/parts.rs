//! The values of parts of shaders, which are kept for re-renders.

/// The values that other parts read of a part of a shader, after it ran.
#[derive(Clone, Debug, Default)]
pub struct PartValues(pub(crate) Vec<KeptValue>);

/// The values of a register.
#[derive(Clone, Debug)]
pub(crate) struct KeptValue {
    pub(crate) slot: u32,
    pub(crate) varying: bool,
    pub(crate) values: Box<[f32]>,
}

impl PartValues {
    /// The bytes that the values take.
    pub fn bytes(&self) -> usize {
        self.0.iter().map(|kept| size_of::<KeptValue>() + size_of_val(&*kept.values)).sum()
    }
}
