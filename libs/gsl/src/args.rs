//! The parameter query (reference chapter 15).

use crate::gso::{self, GslError};
use crate::ir::{ConstValue, DefaultValue, Metadatum, Module, ShaderKind, SymbolType, ValueType};
use std::sync::Arc;

/// One parameter, as programs outside of the renderer see it.
#[derive(Clone, Debug, PartialEq)]
pub struct Arg {
    /// Its name.
    pub name: Arc<str>,
    /// Its type; the length of an open array is that of its default.
    pub ty: SymbolType,
    /// Declared `output`.
    pub is_output: bool,
    /// The default value; `None` when it is computed as the shader starts.
    pub default: Option<ArgDefault>,
    /// Metadata of the parameter.
    pub metadata: Vec<Metadatum>,
}

/// A default value.
#[derive(Clone, Debug, PartialEq)]
pub struct ArgDefault {
    /// Numbers or strings of all elements, one after the other.
    pub value: ConstValue,
    /// The space that the numbers are in: as written, else "rgb" or "common"; `None` for floats and strings.
    pub space: Option<Arc<str>>,
}

/// What can be asked about a compiled shader without running it.
#[derive(Clone, Debug, PartialEq)]
pub struct GsoArgs {
    kind: ShaderKind,
    name: Arc<str>,
    metadata: Vec<Metadatum>,
    args: Vec<Arg>,
}

impl GsoArgs {
    /// From the bytes of a `.gso` file; its code is not decoded. `file` names it in messages.
    ///
    /// # Errors
    /// As [`gso::read`].
    pub fn from_bytes(bytes: &[u8], file: &str) -> Result<Self, GslError> {
        Ok(Self::from_module(&gso::read_interface(bytes, file)?))
    }

    /// From a compiled module.
    pub fn from_module(module: &Module) -> Self {
        let args = module.params.iter().map(|param| {
            let symbol = module.symbol(param.symbol);
            let default = match &param.default {
                DefaultValue::Unknown => None,
                DefaultValue::Known { space, value } => {
                    let implied = match symbol.ty.value {
                        ValueType::Color => Some("rgb"),
                        ValueType::Point | ValueType::Vector | ValueType::Normal | ValueType::Matrix => {
                            Some("common")
                        }
                        _ => None,
                    };
                    let space = space.clone().or(implied.map(Arc::from));
                    Some(ArgDefault { value: value.clone(), space })
                }
            };
            Arg {
                name: symbol.name.clone(),
                ty: symbol.ty,
                is_output: param.output,
                default,
                metadata: param.metadata.clone(),
            }
        });
        Self {
            kind: module.kind,
            name: module.name.clone(),
            metadata: module.metadata.clone(),
            args: args.collect(),
        }
    }

    /// "surface", "displacement", "volume", "light" or "shader".
    pub fn shadertype(&self) -> &'static str {
        self.kind.word()
    }

    /// Name in the source.
    pub fn shadername(&self) -> &str {
        &self.name
    }

    /// Parameters in the order of their declaration.
    pub fn args(&self) -> &[Arg] {
        &self.args
    }

    /// The parameter called `name`.
    pub fn arg(&self, name: &str) -> Option<&Arg> {
        self.args.iter().find(|a| *a.name == *name)
    }

    /// Metadata of the shader as a whole.
    pub fn metadata(&self) -> &[Metadatum] {
        &self.metadata
    }
}
