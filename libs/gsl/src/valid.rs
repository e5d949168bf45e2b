//! Modules that passed the validator.

use crate::error::GslError;
use crate::ir::Module;
use crate::validate::validate;
use std::ops::Deref;
use std::sync::Arc;

/// A module that passed the validator. Every symbol exists, and every operation has permitted operands.
///
/// The type guarantees this. Its field is private, so that [`compile`](crate::compile()),
/// [`gso::read`](crate::gso::read) and [`ValidModule::check`] are the only ways to get one. Linking takes only this
/// type and does not check it again. A copy shares the module.
///
/// ```
/// use granita_gsl::{CompileOptions, ValidModule, compile};
/// let module = compile("surface red () { C = color (1, 0, 0); }", "red.gsl", &CompileOptions::default()).unwrap().module;
/// // A module that somebody has changed is an ordinary one until it is checked.
/// let mut changed = (*module).clone();
/// assert!(ValidModule::check(changed.clone(), "red").is_ok());
/// changed.symbols.clear();
/// let error = ValidModule::check(changed, "red").unwrap_err();
/// assert_eq!(error.to_string(), "red: the code is not valid: there is no symbol 1");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ValidModule(Arc<Module>);

impl ValidModule {
    /// Validates a module. `at` names it in messages.
    ///
    /// # Errors
    /// Returns [`GslError::Malformed`] with the first error of the code.
    pub fn check(module: Module, at: &str) -> Result<Self, GslError> {
        match validate(&module) {
            Ok(()) => Ok(Self(Arc::new(module))),
            Err(what) => {
                let what = format!("the code is not valid: {what}");
                Err(GslError::Malformed { what, at: at.to_owned() })
            }
        }
    }
}

impl Deref for ValidModule {
    type Target = Module;

    fn deref(&self) -> &Module {
        &self.0
    }
}
