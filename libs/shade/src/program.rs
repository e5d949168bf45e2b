//! Symbols as the executor sees them.

use granita_gsl::ir::ValueType;

/// Where a symbol lives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum At {
    /// Register.
    Slot(u32),
    /// Constant of the group.
    Const(u32),
}

/// A symbol as the executor sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) at: At,
    pub(crate) value: ValueType,
    /// Elements, with the true length of variable-length parameters; 1 when not an array.
    pub(crate) elements: u32,
    pub(crate) array: bool,
    /// Values of inactive lanes need not be kept.
    pub(crate) scratch: bool,
}
