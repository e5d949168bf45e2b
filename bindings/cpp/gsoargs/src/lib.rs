//! `libgsoargs.so` provides the functions that `gsoargs.h` needs from a library (reference chapter 15).

#![allow(unsafe_code, reason = "the C interface is made of pointers; every block says why it is sound")]

use granita_base::{ParamType, SearchPath};
use granita_gsl::ir::{ConstValue, Metadatum, SymbolType};
use granita_gsl::{Arg, GsoArgs};
use std::ffi::{CStr, CString, c_char, c_int, c_uint};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

/// The type `gelato_shader_parameter` of `gelato_c.h`.
#[repr(C)]
pub struct Parameter {
    name: *const c_char,
    ty: c_uint,
    isoutput: c_int,
    valid: c_int,
    varlenarray: c_int,
    nfloats: c_int,
    nstrings: c_int,
    nspaces: c_int,
    nmetadata: c_int,
    floats: *const f32,
    strings: *const *const c_char,
    spaces: *const *const c_char,
    metadata: *const Parameter,
}

/// The type `gelato_shader_view` of `gelato_c.h`.
#[repr(C)]
pub struct View {
    name: *const c_char,
    ty: *const c_char,
    error: *const c_char,
    nparameters: c_int,
    nmetadata: c_int,
    parameters: *const Parameter,
    metadata: *const Parameter,
}

/// The type `gelato_shader` of `gelato_c.h`. It owns all data that a view points to, and does not change after the view
/// is returned.
#[derive(Default)]
pub struct Shader {
    texts: Vec<CString>,
    floats: Vec<Vec<f32>>,
    pointers: Vec<Vec<*const c_char>>,
    lists: Vec<Vec<Parameter>>,
}

/// Returns a length as an integer of C.
fn count(n: usize) -> c_int {
    c_int::try_from(n).unwrap_or(c_int::MAX)
}

impl Shader {
    /// Stores a string. Returns a pointer that is valid while `self` lives.
    fn text(&mut self, text: &str) -> *const c_char {
        self.texts.push(CString::new(text.replace('\0', " ")).unwrap_or_default());
        // The string is on the heap, because the list may move.
        self.texts[self.texts.len() - 1].as_ptr()
    }

    fn list(&mut self, list: Vec<Parameter>) -> *const Parameter {
        self.lists.push(list);
        self.lists[self.lists.len() - 1].as_ptr()
    }

    fn values(&mut self, into: &mut Parameter, value: &ConstValue) {
        match value {
            ConstValue::Floats(v) => {
                self.floats.push(v.to_vec());
                into.nfloats = count(v.len());
                into.floats = self.floats[self.floats.len() - 1].as_ptr();
            }
            ConstValue::Strings(v) => {
                let texts: Vec<*const c_char> = v.iter().map(|s| self.text(s)).collect();
                into.nstrings = count(texts.len());
                self.pointers.push(texts);
                into.strings = self.pointers[self.pointers.len() - 1].as_ptr();
            }
        }
    }

    fn metadata(&mut self, list: &[Metadatum]) -> (*const Parameter, c_int) {
        let mut all = Vec::with_capacity(list.len());
        for m in list {
            let mut p = empty(self.text(&m.name), type_bits(&SymbolType::of(m.ty)));
            p.valid = 1;
            self.values(&mut p, &m.value);
            all.push(p);
        }
        let n = count(all.len());
        (self.list(all), n)
    }

    fn parameter(&mut self, arg: &Arg) -> Parameter {
        let mut p = empty(self.text(&arg.name), type_bits(&arg.ty));
        p.isoutput = c_int::from(arg.is_output);
        p.varlenarray = c_int::from(arg.ty.open);
        if let Some(default) = &arg.default {
            p.valid = 1;
            self.values(&mut p, &default.value);
            if !default.spaces.is_empty() {
                let spaces = default.spaces.iter().map(|space| self.text(space)).collect();
                p.nspaces = count(default.spaces.len());
                self.pointers.push(spaces);
                p.spaces = self.pointers[self.pointers.len() - 1].as_ptr();
            }
        }
        (p.metadata, p.nmetadata) = self.metadata(&arg.metadata);
        p
    }

    fn view(&mut self, args: &GsoArgs) -> View {
        let parameters: Vec<Parameter> = args.args().iter().map(|arg| self.parameter(arg)).collect();
        let nparameters = count(parameters.len());
        let (metadata, nmetadata) = self.metadata(args.metadata());
        View {
            name: self.text(args.shadername()),
            ty: self.text(args.shadertype()),
            error: std::ptr::null(),
            nparameters,
            nmetadata,
            parameters: self.list(parameters),
            metadata,
        }
    }

    /// Returns a view that holds only an error.
    fn failed(&mut self, error: &str) -> View {
        View {
            name: std::ptr::null(),
            ty: std::ptr::null(),
            error: self.text(error),
            nparameters: 0,
            nmetadata: 0,
            parameters: std::ptr::null(),
            metadata: std::ptr::null(),
        }
    }
}

fn empty(name: *const c_char, ty: c_uint) -> Parameter {
    Parameter {
        name,
        ty,
        isoutput: 0,
        valid: 0,
        varlenarray: 0,
        nfloats: 0,
        nstrings: 0,
        nspaces: 0,
        nmetadata: 0,
        floats: std::ptr::null(),
        strings: std::ptr::null(),
        spaces: std::ptr::null(),
        metadata: std::ptr::null(),
    }
}

/// Returns the bits of the C++ `ParamType`: the base type, the length, and whether it is an array.
fn type_bits(ty: &SymbolType) -> c_uint {
    let base = ty.value.base_type().unwrap_or_default();
    ParamType { base, array: ty.array, ..ParamType::default() }.to_bits()
}

/// Finds and reads a shader.
fn read(name: &str, path: Option<&str>) -> Result<GsoArgs, String> {
    let path = path.unwrap_or("$GELATOHOME/shaders").replace(';', ":");
    let path = SearchPath::parse(&path, &SearchPath::default(), &std::env::vars_os().collect());
    let stem = name.strip_suffix(".gso").unwrap_or(name);
    let direct = PathBuf::from(name);
    let found = path.find(&format!("{stem}.gso")).or_else(|| direct.is_file().then_some(direct));
    let Some(file) = found else {
        let folders: Vec<String> = path.folders().iter().map(|f| f.display().to_string()).collect();
        return Err(format!("{stem}.gso not found in {}", folders.join(", ")));
    };
    let shown = file.display().to_string();
    let bytes = std::fs::read(&file).map_err(|e| format!("{shown}: {e}"))?;
    GsoArgs::from_bytes(&bytes, &shown).map_err(|e| e.to_string())
}

/// Implements `gelato_shader_open` of `gelato_c.h`.
///
/// # Safety
/// `name` and `path` must be NULL or strings. `view` must be NULL or point to space for a view.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gelato_shader_open(
    name: *const c_char,
    path: *const c_char,
    view: *mut View,
) -> *mut Shader {
    let string = |text: *const c_char| {
        // SAFETY: the pointer is a string by the contract, when it is not NULL.
        (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
    };
    let mut shader = Box::new(Shader::default());
    let made = catch_unwind(AssertUnwindSafe(|| match string(name) {
        Some(name) => read(&name, string(path).as_deref()),
        None => Err("no shader was named (NULL)".to_owned()),
    }));
    let seen = match made {
        Ok(Ok(args)) => shader.view(&args),
        Ok(Err(what)) => shader.failed(&what),
        Err(_) => shader.failed("the shader cannot be read"),
    };
    if !view.is_null() {
        // SAFETY: there is space for a view, by the contract.
        unsafe { view.write(seen) };
    }
    Box::into_raw(shader)
}

/// Implements `gelato_shader_close` of `gelato_c.h`.
///
/// # Safety
/// `shader` must be NULL or come from [`gelato_shader_open`], and must not be used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gelato_shader_close(shader: *mut Shader) {
    if !shader.is_null() {
        // SAFETY: by the contract it is a box that is released now.
        drop(unsafe { Box::from_raw(shader) });
    }
}
