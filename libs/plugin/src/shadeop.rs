//! Shadeops (reference 14), which are C++ functions that shaders call, in shared libraries beside the shaders.

use crate::Plugins;
use crate::dso::Dso;
use crate::ffi::{self, ABI, Text};
use crate::plugins::endings;
use granita_base::{BaseType, Param, ParamData, ParamType, SearchPath, Severity, Vec3};
use granita_gsl::{ShadeopCall, ShadeopForm};
use granita_shade::{
    NoiseForm, OptionValue, Shadeop, ShadeopContext, ShadeopData, Spot, is_text_option, noise_at,
};
use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The value of `SHADEOP_VERSION` and `SHADEOP_PROTOCOL`.
const VERSION: c_int = 1;

/// Locked while a function runs that does not declare that it may run in several threads at once. A library exists once
/// per process.
static ALONE: Mutex<()> = Mutex::new(());

/// The structure `gelato_argument`.
#[repr(C)]
struct Argument {
    data: *mut c_void,
    stride: c_int,
    varying: c_int,
    ty: c_uint,
    item_bytes: c_int,
}

/// The structure `gelato_execution_calls`.
#[repr(C)]
struct ExecutionCalls {
    abi: c_int,
    forcevarying: extern "C" fn(*mut Execution, c_int) -> c_int,
    tokenize: extern "C" fn(*mut Execution, *const c_char) -> *const c_char,
    error: extern "C" fn(*mut Execution, *const c_char),
    lookup: extern "C" fn(
        *mut Execution,
        c_int,
        *const c_char,
        c_int,
        c_int,
        *const f32,
        *mut f32,
        c_int,
        *const *const c_char,
        *const *const c_void,
    ),
    gettextureinfo: extern "C" fn(*mut Execution, *const c_char, *const c_char, c_uint, *mut c_void) -> c_int,
    getattribute: extern "C" fn(*mut Execution, *const c_char, c_uint, *mut c_void) -> c_int,
    getsymbol: extern "C" fn(*mut Execution, *const c_char) -> c_int,
}

static CALLS: ExecutionCalls = ExecutionCalls {
    abi: ABI,
    forcevarying,
    tokenize,
    error,
    lookup,
    gettextureinfo,
    getattribute,
    getsymbol,
};

/// The structure `gelato_execution`, with the state of this library.
#[repr(C)]
pub(crate) struct Execution {
    calls: *const ExecutionCalls,
    active: *const i16,
    arguments: *mut Argument,
    begin: c_int,
    end: c_int,
    raylevel: c_int,
    isshadowray: c_int,
    isindirectray: c_int,
    // The plugin does not see this field.
    state: *mut c_void,
}

/// The Rust side of a run.
struct State<'s> {
    context: &'s mut dyn ShadeopContext,
    arguments: Vec<Argument>,
    /// The pointers to the strings of each argument of strings.
    pointers: BTreeMap<usize, Vec<*const c_char>>,
    texts: BTreeMap<Arc<str>, CString>,
    alone: Option<MutexGuard<'static, ()>>,
}

unsafe extern "C" {
    fn gelato_shim_shadeop(
        function: *mut c_void,
        execution: *mut Execution,
        nargs: c_int,
        args: *const c_int,
        message: ffi::Message,
    ) -> c_int;
}

/// A function of a library.
struct PluginShadeop {
    function: *mut c_void,
    /// True when it may run in several threads at once.
    safe: bool,
    title: String,
}

// SAFETY: it is the address of a function.
unsafe impl Send for PluginShadeop {}
// SAFETY: as above. Functions that must not run at once are locked.
unsafe impl Sync for PluginShadeop {}

/// The value of `PT_VOID`, which no parameter has but results may have.
const VOID: u32 = 1;

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock()
}

impl State<'_> {
    /// Returns a string that is valid as long as the run.
    fn text(&mut self, text: &Arc<str>) -> *const c_char {
        if !self.texts.contains_key(text) {
            let kept = CString::new(text.replace('\0', " ")).unwrap_or_default();
            self.texts.insert(text.clone(), kept);
        }
        self.texts.get(text).map_or(std::ptr::null(), |kept| kept.as_ptr())
    }

    /// Describes argument `k`, at the start or after its data moved.
    fn describe(&mut self, k: usize) {
        let arg = &mut self.context.args()[k];
        let (width, varying) = (arg.width(), arg.varying);
        let base = arg.value.base_type();
        let ty =
            base.map_or(VOID, |base| ParamType { base, array: arg.array, ..ParamType::default() }.to_bits());
        let texts = match &mut arg.data {
            ShadeopData::Floats(v) => Err(v.as_mut_ptr().cast::<c_void>()),
            ShadeopData::Strings(v) => Ok(v.clone()),
        };
        let (data, item_bytes) = match texts {
            Err(data) => (data, 4),
            Ok(texts) => {
                let list: Vec<*const c_char> = texts.iter().map(|t| self.text(t)).collect();
                self.pointers.insert(k, list);
                let list = self.pointers.get_mut(&k).map_or(std::ptr::null_mut(), |l| l.as_mut_ptr());
                (list.cast(), size_of::<*const c_char>())
            }
        };
        let stride = if varying { c_int::try_from(width).unwrap_or(0) } else { 0 };
        let described = Argument {
            data,
            stride,
            varying: c_int::from(varying),
            ty,
            item_bytes: c_int::try_from(item_bytes).unwrap_or(4),
        };
        if k < self.arguments.len() {
            self.arguments[k] = described;
        } else {
            self.arguments.push(described);
        }
    }

    /// Copies back the strings that the function stored.
    fn take_back(&mut self) {
        for (k, list) in std::mem::take(&mut self.pointers) {
            let arg = &mut self.context.args()[k];
            let ShadeopData::Strings(texts) = &mut arg.data else { continue };
            if !arg.output {
                continue;
            }
            let mut last: Option<(*const c_char, Arc<str>)> = None;
            for (to, &pointer) in texts.iter_mut().zip(&list) {
                let text = match &last {
                    Some((known, text)) if *known == pointer => text.clone(),
                    // SAFETY: the pointer is an original one, or one that `tokenize` returned. Both are strings.
                    _ => unsafe { ffi::text(pointer) }.map_or_else(|| "".into(), |t| Arc::from(&*t)),
                };
                last = Some((pointer, text.clone()));
                *to = text;
            }
        }
    }
}

impl Shadeop for PluginShadeop {
    fn run(&self, context: &mut dyn ShadeopContext) -> Result<(), String> {
        let n = context.points();
        let mut flags = vec![0i16; n];
        context.active().iter().for_each(|&i| flags[i as usize] = 1);
        let begin = context.active().first().map_or(0, |&i| i as c_int);
        let end = context.active().last().map_or(0, |&i| i as c_int + 1);
        let (ray, nargs) = (context.ray(), context.args().len());
        let mut state = State {
            context,
            arguments: Vec::new(),
            pointers: BTreeMap::new(),
            texts: BTreeMap::new(),
            alone: (!self.safe).then(alone),
        };
        (0..nargs).for_each(|k| state.describe(k));
        let mut execution = Execution {
            calls: &raw const CALLS,
            active: flags.as_ptr(),
            arguments: state.arguments.as_mut_ptr(),
            begin,
            end,
            raylevel: c_int::try_from(ray.level).unwrap_or(c_int::MAX),
            isshadowray: c_int::from(ray.shadow),
            isindirectray: c_int::from(ray.indirect),
            state: (&raw mut state).cast(),
        };
        let handles: Vec<c_int> = (0..nargs).map(|k| k as c_int).collect();
        let mut why = Text::new();
        // SAFETY: the function has the form that its table declares, and all that is passed to it lives until it is
        // done.
        let status = unsafe {
            gelato_shim_shadeop(
                self.function,
                &raw mut execution,
                nargs as c_int,
                handles.as_ptr(),
                why.room(),
            )
        };
        state.take_back();
        match status {
            ffi::THREW => {
                Err(format!("{} threw an exception: {}", self.title, why.get().unwrap_or_default()))
            }
            _ => Ok(()),
        }
    }
}

/// Runs `f` with the state of a run. Returns `nothing` when it panics.
fn with<T>(execution: *mut Execution, nothing: T, f: impl FnOnce(&mut State<'_>) -> T) -> T {
    // SAFETY: the table is called by the function that runs, with its execution. The state lives meanwhile, and no
    // other code uses it, because `run` waits for the function.
    unsafe {
        let Some(execution) = execution.as_mut() else { return nothing };
        let Some(state) = execution.state.cast::<State<'_>>().as_mut() else { return nothing };
        let result = catch_unwind(AssertUnwindSafe(|| f(state))).unwrap_or(nothing);
        execution.arguments = state.arguments.as_mut_ptr();
        result
    }
}

extern "C" fn forcevarying(execution: *mut Execution, argument: c_int) -> c_int {
    with(execution, 0, |state| {
        let points = state.context.points();
        let Some(k) = usize::try_from(argument).ok().filter(|k| *k < state.arguments.len()) else { return 0 };
        state.context.args()[k].spread(points);
        state.describe(k);
        1
    })
}

extern "C" fn tokenize(execution: *mut Execution, text: *const c_char) -> *const c_char {
    with(execution, c"".as_ptr(), |state| {
        // SAFETY: the text is a string, or NULL.
        let text = unsafe { ffi::text(text) }.unwrap_or_default();
        let text: Arc<str> = Arc::from(&*text);
        state.text(&text)
    })
}

extern "C" fn error(execution: *mut Execution, text: *const c_char) {
    with(execution, (), |state| {
        // SAFETY: the text is a string, or NULL.
        let text = unsafe { ffi::text(text) }.unwrap_or_default();
        state.context.complain(&text);
    });
}

/// The largest number of channels, and of options, of one lookup.
const MOST: usize = 64;

extern "C" fn lookup(
    execution: *mut Execution,
    what: c_int,
    name: *const c_char,
    firstchannel: c_int,
    nchannels: c_int,
    at: *const f32,
    result: *mut f32,
    nparams: c_int,
    names: *const *const c_char,
    data: *const *const c_void,
) {
    with(execution, (), |state| {
        // SAFETY: the name is a string, or NULL.
        let name = unsafe { ffi::text(name) }.unwrap_or_default().into_owned();
        let channels = usize::try_from(nchannels).unwrap_or(0).min(MOST);
        if channels == 0 || result.is_null() {
            return;
        }
        let mut texts: Vec<(String, Option<String>, f32)> = Vec::new();
        let count = usize::try_from(nparams).unwrap_or(0).min(MOST);
        for k in 0..if names.is_null() || data.is_null() { 0 } else { count } {
            // SAFETY: by the interface the lists have `nparams` entries. The data is a float or a string, depending on
            // the name.
            let (option, value) = unsafe { (ffi::text(*names.add(k)).unwrap_or_default(), *data.add(k)) };
            if value.is_null() {
                continue;
            }
            if is_text_option(&option) {
                // SAFETY: the data of such an option is a `char *`.
                let text = unsafe { ffi::text(*value.cast::<*const c_char>()) };
                texts.push((option.into_owned(), Some(text.unwrap_or_default().into_owned()), 0.0));
            } else {
                // SAFETY: the data of such an option is a float.
                texts.push((option.into_owned(), None, unsafe { *value.cast::<f32>() }));
            }
        }
        if firstchannel != 0 {
            texts.push(("firstchannel".to_owned(), None, firstchannel as f32));
        }
        let options: Vec<(&str, OptionValue<'_>)> = texts
            .iter()
            .map(|(name, text, number)| match text {
                Some(text) => (&**name, OptionValue::Text(text)),
                None => (&**name, OptionValue::Number(*number)),
            })
            .collect();
        let mut out = vec![0.0f32; channels];
        // The lock is released during the lookup, because a ray may hit an object whose shader calls such a function.
        let held = state.alone.take().is_some();
        // SAFETY: the headers pass six floats for textures and nine for the others.
        let number = |k: usize| unsafe { *at.add(k) };
        let triple = |k: usize| Vec3::new(number(k), number(k + 1), number(k + 2));
        match what {
            0 => {
                let at = std::array::from_fn(number);
                state.context.texture(&name, at, &options, &mut out);
            }
            1 | 2 => {
                let spot = Spot { at: triple(0), dx: triple(3), dy: triple(6) };
                match what {
                    1 => state.context.shadow(&name, spot, &options, &mut out),
                    _ => state.context.environment(&name, spot, &options, &mut out),
                }
            }
            _ => {}
        }
        state.alone = held.then(alone);
        // SAFETY: by the interface there is room for the channels.
        unsafe { std::ptr::copy_nonoverlapping(out.as_ptr(), result, channels) };
    });
}

/// Stores the value of a parameter in a variable of a type. Returns 1 when it fits, else 0.
fn answer(state: &mut State<'_>, param: Option<Param>, bits: c_uint, result: *mut c_void) -> c_int {
    let Some(param) = param.filter(|_| !result.is_null()) else { return 0 };
    let Ok(ty) = ParamType::from_bits(bits) else { return 0 };
    let n = ty.width();
    if param.data.len() != n {
        return 0;
    }
    // SAFETY: by the interface there is room for a value of the requested type.
    unsafe {
        match (&param.data, ty.base) {
            (ParamData::String(v), BaseType::String) => {
                let list: Vec<*const c_char> = v.iter().map(|t| state.text(t)).collect();
                std::ptr::copy_nonoverlapping(list.as_ptr(), result.cast(), n);
            }
            (ParamData::Int(v), BaseType::Int) => {
                std::ptr::copy_nonoverlapping(v.as_ptr(), result.cast(), n);
            }
            (_, BaseType::String | BaseType::Int) => return 0,
            (data, _) => {
                let Some(v) = data.to_floats() else { return 0 };
                std::ptr::copy_nonoverlapping(v.as_ptr(), result.cast(), n);
            }
        }
    }
    1
}

extern "C" fn gettextureinfo(
    execution: *mut Execution,
    texture: *const c_char,
    name: *const c_char,
    bits: c_uint,
    result: *mut c_void,
) -> c_int {
    with(execution, 0, |state| {
        // SAFETY: the texture and the name are strings, or NULL.
        let (texture, name) = unsafe { (ffi::text(texture), ffi::text(name)) };
        let (Some(texture), Some(name)) = (texture, name) else { return 0 };
        let param = state.context.texture_info(&texture, &name);
        answer(state, param, bits, result)
    })
}

extern "C" fn getattribute(
    execution: *mut Execution,
    name: *const c_char,
    bits: c_uint,
    result: *mut c_void,
) -> c_int {
    with(execution, 0, |state| {
        // SAFETY: the name is a string, or NULL.
        let Some(name) = (unsafe { ffi::text(name) }) else { return 0 };
        let param = state.context.attribute(&name);
        answer(state, param, bits, result)
    })
}

extern "C" fn getsymbol(execution: *mut Execution, name: *const c_char) -> c_int {
    with(execution, -1, |state| {
        // SAFETY: the name is a string, or NULL.
        let Some(name) = (unsafe { ffi::text(name) }) else { return -1 };
        match state.context.symbol(&name) {
            Some(k) => {
                state.describe(k);
                k as c_int
            }
            None => -1,
        }
    })
}

/// Computes the noise of the language for `noise.h`, as a `gelato_noise_function`.
///
/// # Safety
/// `x` (and `period`, for periodic kinds) have `indim` floats, and `out` has space for `outdim`.
pub unsafe extern "C" fn noise(
    kind: c_int,
    indim: c_int,
    x: *const f32,
    period: *const f32,
    outdim: c_int,
    out: *mut f32,
) {
    let (Ok(indim @ 1..=4), Ok(outdim @ 1..=64)) = (usize::try_from(indim), usize::try_from(outdim)) else {
        return;
    };
    if x.is_null() || out.is_null() {
        return;
    }
    let form = match kind {
        0 | 3 => NoiseForm::Noise,
        1 | 4 => NoiseForm::Signed,
        2 => NoiseForm::Cell,
        _ => return,
    };
    // SAFETY: the arrays have these lengths by the contract.
    let (x, period, out) = unsafe {
        (
            std::slice::from_raw_parts(x, indim),
            (kind >= 3 && !period.is_null()).then(|| std::slice::from_raw_parts(period, indim)),
            std::slice::from_raw_parts_mut(out, outdim),
        )
    };
    let _ = catch_unwind(AssertUnwindSafe(|| noise_at(form, x, period, out)));
}

/// Returns a library that may contain shadeops. Checks its version and passes it the noise function.
fn library(dso: &'static Dso) -> Result<&'static Dso, String> {
    for name in ["shadeop_version", "shadeop_protocol"] {
        if let Some(other) = dso.int(name).filter(|v| *v != VERSION) {
            return Err(format!("its {name} is {other}, and this suite takes {VERSION}"));
        }
    }
    if let Some(bind) = dso.symbol("gelato_bind_noise") {
        type Noise = unsafe extern "C" fn(c_int, c_int, *const f32, *const f32, c_int, *mut f32);
        // SAFETY: the function of noise.h, which takes such a pointer.
        let bind: extern "C" fn(Noise) = unsafe { std::mem::transmute(bind) };
        bind(noise);
    }
    Ok(dso)
}

impl Plugins {
    /// Returns the libraries in the folders of a path that may contain shadeops. The one called `name` comes first,
    /// then the others by name.
    fn libraries(&self, name: &str, path: &SearchPath) -> Vec<PathBuf> {
        let mut list = Vec::new();
        if self.rules().none {
            return list;
        }
        let is_it = |file: &str| endings().iter().any(|end| file == format!("{name}.{end}"));
        list.extend(self.rules().libraries(is_it));
        let folders = || self.rules().folders(path.folders(), true);
        for (folder, counts) in folders() {
            if !counts {
                self.tell_passed_over(folder);
                continue;
            }
            for ending in endings() {
                let file = folder.join(format!("{name}.{ending}"));
                let is_there = self.rules().is_file(&file);
                self.tell(&file, if is_there { "found" } else { "does not exist" });
                if is_there {
                    list.push(file);
                }
            }
        }
        for (folder, _) in folders().filter(|(_, counts)| *counts) {
            let Some(entries) = self.rules().entries(folder) else { continue };
            let is_library = |path: &Path| {
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                let mut words = file.split('.');
                let (_, ending) = (words.next(), words.next());
                ending.is_some_and(|e| endings().contains(&e)) && words.next().is_none()
            };
            let is_new = |path: &PathBuf| is_library(path) && !list.contains(path);
            let mut here: Vec<PathBuf> = entries.into_iter().filter(is_new).collect();
            here.sort();
            list.extend(here);
        }
        list
    }

    /// Returns the forms of the function `name`, from the first library that declares it.
    pub fn shadeop_forms(&self, name: &str, path: &SearchPath) -> Vec<ShadeopForm> {
        for file in self.libraries(name, path) {
            let Some(dso) = self.load(&file, library, Severity::Warning) else { continue };
            let Some(table) = dso.strings(&format!("{name}_shadeop")) else {
                self.tell(&file, &format!("has no symbol {name}_shadeop"));
                continue;
            };
            self.tell(&file, &format!("declares {name} in {} forms", table.len()));
            let stem: Arc<str> = dso.stem.as_str().into();
            return table
                .into_iter()
                .map(|declaration| ShadeopForm { library: stem.clone(), declaration })
                .collect();
        }
        Vec::new()
    }

    /// Returns the function that a compiled shader calls, by the text of `granita_gsl::ShadeopCall`.
    ///
    /// # Errors
    /// Returns the reason why there is none.
    pub fn shadeop(&self, text: &str, path: &SearchPath) -> Result<Arc<dyn Shadeop>, String> {
        let call = ShadeopCall::parse(text).ok_or("a shadeop without a name")?;
        let table = format!("{}_shadeop", call.name);
        for file in self.libraries(call.library, path) {
            let Some(dso) = self.load(&file, library, Severity::Warning) else { continue };
            let Some(declared) = dso.strings(&table) else { continue };
            let takes = call.outputs.len();
            let fits = |d: &String| {
                let (head, rest) = d.split_once('(').unwrap_or((d, ""));
                let n = rest.split(',').filter(|a| !a.trim_matches([' ', ')']).is_empty()).count();
                head.split_whitespace().nth(1) == Some(call.function) && n == takes
            };
            if !declared.iter().any(fits) {
                return Err(format!(
                    "{} declares no form {} of {takes} arguments any more; compile the shader again",
                    file.display(),
                    call.function
                ));
            }
            let Some(function) = dso.symbol(call.function) else {
                return Err(format!("{} has no symbol {}", file.display(), call.function));
            };
            // The symbol has one underscore as in the reference's example, or two as in its text.
            let safe = ["_threadsafe", "__threadsafe"]
                .iter()
                .any(|end| dso.int(&format!("{}{end}", call.name)).is_some_and(|v| v != 0));
            let title = format!("plugin {}", dso.path.display());
            return Ok(Arc::new(PluginShadeop { function, safe, title }));
        }
        let folders: Vec<String> = path.folders().iter().map(|f| f.display().to_string()).collect();
        let looked = if !self.rules().none {
            folders.join(", ")
        } else {
            "no folder: plugins are not allowed".to_owned()
        };
        Err(format!("no library declares shadeop `{}` (looked in {looked})", call.name))
    }
}
