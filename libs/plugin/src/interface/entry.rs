//! The functions of a `gelato_calls` table. They check pointers and lengths, and catch panics.

use super::Interface;
use super::values::Source;
use crate::ffi::{self, ABI, Calls, Errors, Knots, Text};
use granita_base::shape::KnotSpan;
use granita_base::{ParamData, ShapeDesc, TrimDesc};
use std::cell::UnsafeCell;
use std::ffi::{CStr, CString, c_char, c_int, c_uint, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// An interface at a fixed address, for calls from C and C++.
pub struct InterfaceObject<'a> {
    /// True while a call is being executed. Other calls are refused meanwhile.
    busy: AtomicBool,
    errors: crate::Messages,
    /// Answers commands and queries while a call is being executed.
    meanwhile: Option<Arc<dyn Meanwhile>>,
    interface: UnsafeCell<Interface<'a>>,
}

/// The calls that a renderer answers while it renders.
pub trait Meanwhile: Send + Sync {
    /// Executes a command. Returns false for a command that must wait.
    fn command(&self, name: &str) -> bool;
    /// Returns the value of an attribute that is known at that time.
    fn attribute(&self, name: &str) -> Option<granita_base::Param>;
}

impl std::fmt::Debug for InterfaceObject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("InterfaceObject")
    }
}

impl<'a> InterfaceObject<'a> {
    /// Returns an object that is ready for calls.
    pub fn new(interface: Interface<'a>, meanwhile: Option<Arc<dyn Meanwhile>>) -> Self {
        let errors = interface.errors.clone();
        Self { busy: AtomicBool::new(false), errors, meanwhile, interface: UnsafeCell::new(interface) }
    }

    /// Returns the interface.
    pub fn into_inner(self) -> Interface<'a> {
        self.interface.into_inner()
    }

    /// Runs the `run` of a C++ generator, whose calls go to this interface.
    pub(crate) fn run_generator(&self, generator: &GeneratorObject, params: &str) -> Result<(), String> {
        let params = c_string(params);
        let mut why = Text::new();
        // SAFETY: the generator lives, the table fits this object, and both outlive the call.
        let status = unsafe {
            ffi::gelato_shim_generator_run(
                generator.0,
                &raw const BORROWED,
                self.address(),
                params.as_ptr(),
                why.room(),
            )
        };
        match status {
            ffi::OK => Ok(()),
            ffi::THREW => Err(format!("run threw an exception: {}", why.get().unwrap_or_default())),
            _ => Err(format!("run failed: {}", why.get().unwrap_or_default())),
        }
    }

    /// Runs a generator in C.
    pub(crate) fn run_table(
        &self,
        run: unsafe extern "C" fn(*const Calls, *mut c_void, *const c_char, *mut c_char, usize) -> c_int,
        params: &str,
    ) -> Result<(), String> {
        let params = c_string(params);
        let mut why = Text::new();
        let room = why.room();
        // SAFETY: it is the plugin's own function, called with a table that fits this object and outlives the call.
        let status =
            unsafe { run(&raw const BORROWED, self.address(), params.as_ptr(), room.text, room.size) };
        match status {
            ffi::OK => Ok(()),
            _ => Err(why.get().unwrap_or_else(|| "failed without a reason".to_owned())),
        }
    }

    fn address(&self) -> *mut c_void {
        (&raw const *self).cast_mut().cast()
    }
}

impl InterfaceObject<'static> {
    /// Returns a C++ renderer that owns this object; `None` when memory is exhausted.
    pub fn into_renderer(self) -> Option<*mut c_void> {
        let this = Box::into_raw(Box::new(self));
        // SAFETY: the table fits the object, whose last use is its `destroy`.
        let renderer = unsafe { ffi::gelato_shim_renderer(&raw const OWNED, this.cast()) };
        if renderer.is_null() {
            // SAFETY: it was not passed on.
            drop(unsafe { Box::from_raw(this) });
            return None;
        }
        Some(renderer)
    }
}

/// Returns a string for C. A 0 inside of it becomes a blank.
pub(crate) fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// A C++ `GelatoAPI::Generator` that the renderer owns.
#[derive(Debug)]
pub struct GeneratorObject(pub(crate) *mut c_void);

// SAFETY: one thread at a time uses the object. It is owned, and only its `run` and `bound` are called, from the thread
// that reads the scene.
unsafe impl Send for GeneratorObject {}
// SAFETY: as above. `&self` is used by the thread that reads the scene.
unsafe impl Sync for GeneratorObject {}

impl GeneratorObject {
    /// Returns its own bound, if it has one.
    pub(crate) fn bound(&self) -> Result<Option<[f32; 6]>, String> {
        let (mut bound, mut why) = ([0.0f32; 6], Text::new());
        // SAFETY: the generator is live, and there is room for six floats.
        match unsafe { ffi::gelato_shim_generator_bound(self.0, bound.as_mut_ptr(), why.room()) } {
            ffi::OK => Ok(Some(bound)),
            ffi::THREW => Err(format!("bound threw an exception: {}", why.get().unwrap_or_default())),
            _ => Ok(None),
        }
    }
}

impl Drop for GeneratorObject {
    fn drop(&mut self) {
        // SAFETY: it belongs to the renderer, which deletes it once. The shim accepts null and catches exceptions.
        unsafe { ffi::gelato_shim_generator_destroy(self.0) }
    }
}

/// The table of an interface that its Rust owner ends.
static BORROWED: Calls = table(None);
/// The table of an interface that ends with its C++ renderer.
static OWNED: Calls = table(Some(destroy));

const fn table(destroy: Option<extern "C" fn(*mut c_void)>) -> Calls {
    Calls {
        abi: ABI,
        words,
        numbers,
        value,
        get_attribute,
        light_switch,
        points,
        curves,
        nurbs_curves,
        patch,
        nurbs_patch,
        mesh,
        trim_curve,
        input_generator,
        errors,
        destroy,
    }
}

/// Runs `f` with the interface behind `this`. A call during another one (from a handler, an image or another thread) is
/// passed to `else_`. A panic becomes a message.
fn enter<T>(
    this: *mut c_void,
    name: &str,
    f: impl FnOnce(&mut Interface<'_>) -> T,
    else_: impl FnOnce(&InterfaceObject<'_>) -> Option<T>,
) -> Option<T> {
    // SAFETY: tables are called with the object that they belong to. It is alive, and is only changed behind `busy`.
    let object: &InterfaceObject<'_> = unsafe { this.cast::<InterfaceObject<'_>>().as_ref()? };
    if object.busy.swap(true, Ordering::Acquire) {
        let answer = catch_unwind(AssertUnwindSafe(|| else_(object))).ok().flatten();
        if answer.is_none() {
            let what = format!("{name} is ignored: the renderer is busy with another call");
            object.errors.reporter().error(what);
        }
        return answer;
    }
    // SAFETY: `busy` was false and is now set by this call, so that no other call uses the interface.
    let interface = unsafe { &mut *object.interface.get() };
    let result = catch_unwind(AssertUnwindSafe(|| f(interface)));
    object.busy.store(false, Ordering::Release);
    match result {
        Ok(value) => Some(value),
        Err(panic) => {
            let text = crate::panic_text(&*panic);
            object.errors.reporter().error(format!("{name} failed inside of the renderer: {text}"));
            None
        }
    }
}

/// Runs `f` as [`enter`] does, for calls that are refused during another one.
fn take(this: *mut c_void, name: &str, f: impl FnOnce(&mut Interface<'_>)) {
    let _ = enter(this, name, f, |_| None);
}

/// Returns a copy of a string; `None` for NULL.
fn string(text: *const c_char) -> Option<String> {
    // SAFETY: strings of the interface are NULL or end with 0.
    unsafe { ffi::text(text) }.map(std::borrow::Cow::into_owned)
}

/// Returns `n` values behind a pointer; `None` for NULL, unless `n` is 0.
fn values<'a, T>(data: *const T, n: usize) -> Option<&'a [T]> {
    if n == 0 {
        return Some(&[]);
    }
    // SAFETY: by the interface the caller's arrays are as long as its other arguments state.
    (!data.is_null() && n <= isize::MAX as usize / size_of::<T>().max(1))
        .then(|| unsafe { std::slice::from_raw_parts(data, n) })
}

/// Returns the sum of counts; `None` when one of them is negative.
fn sum(counts: &[c_int]) -> Option<usize> {
    counts.iter().try_fold(0usize, |sum, n| sum.checked_add(usize::try_from(*n).ok()?))
}

const WORD_CALLS: [&str; 20] = [
    "Input",
    "Camera",
    "Output",
    "World",
    "Render",
    "Comment",
    "Command",
    "PushAttributes",
    "PopAttributes",
    "SaveAttributes",
    "RestoreAttributes",
    "Modify",
    "PushTransform",
    "PopTransform",
    "SetTransform",
    "Shader",
    "Light",
    "ShaderGroupBegin",
    "ShaderGroupEnd",
    "ConnectShaders",
];

extern "C" fn words(
    this: *mut c_void,
    call: c_int,
    a: *const c_char,
    b: *const c_char,
    c: *const c_char,
    d: *const c_char,
) {
    let name = usize::try_from(call).ok().and_then(|k| WORD_CALLS.get(k)).copied().unwrap_or("a scene call");
    let _ = enter(
        this,
        name,
        // SAFETY: strings of the interface are NULL or end with 0.
        |i| i.words(call, [a, b, c, d].map(|word| unsafe { ffi::text(word) }.map(|text| Arc::from(&*text)))),
        |object| {
            let command = (name == "Command").then(|| string(a)).flatten()?;
            object.meanwhile.as_ref().filter(|m| m.command(&command)).map(|_| ())
        },
    );
}

extern "C" fn numbers(this: *mut c_void, call: c_int, n: c_int, v: *const f32, word: *const c_char) {
    take(this, "a scene call", |i| match values(v, usize::try_from(n).unwrap_or(0)) {
        Some(v) => i.numbers(call, v, string(word)),
        None => i.refuse("a transformation, time or bound is missing (NULL)".to_owned()),
    });
}

extern "C" fn value(
    this: *mut c_void,
    attribute: c_int,
    name: *const c_char,
    bits: c_uint,
    kind: c_int,
    data: *const c_void,
) {
    take(this, if attribute == 0 { "Parameter" } else { "Attribute" }, |i| {
        if name.is_null() {
            return i.complain("a parameter or attribute has no name (NULL)");
        }
        // SAFETY: the name is a string that is not NULL, and the data is of the kind that was passed.
        let (name, source) = unsafe { (CStr::from_ptr(name), Source::new(kind, data)) };
        i.value(attribute != 0, name, bits, source);
    });
}

extern "C" fn get_attribute(this: *mut c_void, name: *const c_char, kind: c_int, out: *mut c_void) -> c_int {
    let Some(name) = string(name).filter(|_| !out.is_null()) else { return 0 };
    let found = enter(
        this,
        "GetAttribute",
        |i| i.attribute(&name).is_some_and(|param| answer(i, &param.data, kind, out)),
        |object| {
            let word = name.split_whitespace().next_back().unwrap_or_default();
            let param = object.meanwhile.as_ref()?.attribute(word)?;
            let numbers = param.data.to_floats()?;
            Some(number(numbers.first().copied()?, kind, out))
        },
    );
    c_int::from(found.unwrap_or(false))
}

/// Stores one number in a variable of a kind. Returns false for a kind without numbers.
fn number(v: f32, kind: c_int, out: *mut c_void) -> bool {
    // SAFETY: by the interface `out` is the address of a variable of this kind.
    unsafe {
        match kind {
            1 | 5 => *out.cast::<c_int>() = v as c_int,
            0 | 2 | 6 => *out.cast::<f32>() = v,
            3 => *out.cast::<f64>() = f64::from(v),
            _ => return false,
        }
    }
    true
}

/// Stores data in a variable of a kind. Returns false, and writes nothing, when the data does not fit.
fn answer(i: &mut Interface<'_>, data: &ParamData, kind: c_int, out: *mut c_void) -> bool {
    let texts: Vec<*const c_char> =
        Interface::strings_of(data).to_vec().iter().map(|text| i.keep_answer(text)).collect();
    let is_text = matches!(data, ParamData::String(_));
    if data.is_empty() || is_text != matches!(kind, 4 | 7) && kind != 0 {
        return false;
    }
    // SAFETY: by the interface `out` has room for the attribute's values, or one of them for kinds of one.
    unsafe {
        if is_text {
            let n = if kind == 4 { 1 } else { texts.len() };
            std::ptr::copy_nonoverlapping(texts.as_ptr(), out.cast(), n);
            return true;
        }
        let floats = data.to_floats().unwrap_or_default();
        match (kind, data) {
            (1..=3, _) => return number(floats[0], kind, out),
            (0 | 5, ParamData::Int(v)) => std::ptr::copy_nonoverlapping(v.as_ptr(), out.cast(), v.len()),
            (5, _) => {
                let Some(v) = data.to_ints() else { return false };
                std::ptr::copy_nonoverlapping(v.as_ptr(), out.cast(), v.len());
            }
            _ => std::ptr::copy_nonoverlapping(floats.as_ptr(), out.cast(), floats.len()),
        }
    }
    true
}

extern "C" fn light_switch(this: *mut c_void, id: *const c_char, on: c_int) {
    take(this, "LightSwitch", |i| {
        let id = string(id).unwrap_or_default().into();
        i.call(granita_scene::Call::LightSwitch { id, on: on != 0 });
    });
}

extern "C" fn points(this: *mut c_void, n: c_int) {
    take(this, "Points", |i| {
        if let Some(n) = i.count("Points", n) {
            i.shape(ShapeDesc::Points { n });
        }
    });
}

extern "C" fn curves(this: *mut c_void, interp: *const c_char, ncurves: c_int, nverts: c_int) {
    take(this, "Curves", |i| {
        let Some(basis) = i.basis("Curves", string(interp)) else { return };
        if let (Some(ncurves), Some(nverts)) = (i.count("Curves", ncurves), i.count("Curves", nverts)) {
            i.shape(ShapeDesc::Curves { basis, ncurves, nverts });
        }
    });
}

/// Returns a direction of a NURBS. An error is reported.
fn span(i: &mut Interface<'_>, call: &str, knots: *const Knots) -> Option<KnotSpan> {
    // SAFETY: the shim passes the address of a structure of its own.
    let knots = unsafe { knots.as_ref() };
    let made = knots.and_then(|k| {
        let (n, order) = (usize::try_from(k.n).ok()?, usize::try_from(k.order).ok()?);
        let all = values(k.knot, n.checked_add(order)?)?;
        Some(KnotSpan { n, order, knots: all.into(), min: k.min, max: k.max })
    });
    if made.is_none() {
        i.refuse(format!("{call}: the knots are missing, or their number is not valid"));
    }
    made
}

extern "C" fn nurbs_curves(this: *mut c_void, ncurves: c_int, knots: *const Knots) {
    take(this, "Curves", |i| {
        let Some(span) = span(i, "Curves", knots) else { return };
        if let Some(ncurves) = i.count("Curves", ncurves) {
            i.nurbs_curves(ncurves, span);
        }
    });
}

extern "C" fn patch(this: *mut c_void, interp: *const c_char, nu: c_int, nv: c_int) {
    take(this, "Patch", |i| {
        let Some((u, v)) = i.bases("Patch", string(interp)) else { return };
        if let (Some(nu), Some(nv)) = (i.count("Patch", nu), i.count("Patch", nv)) {
            i.shape(ShapeDesc::Patch { u, v, nu, nv });
        }
    });
}

extern "C" fn nurbs_patch(this: *mut c_void, u: *const Knots, v: *const Knots) {
    take(this, "Patch", |i| {
        if let Some(u) = span(i, "Patch", u)
            && let Some(v) = span(i, "Patch", v)
        {
            i.shape(ShapeDesc::Nurbs { u, v });
        }
    });
}

extern "C" fn mesh(
    this: *mut c_void,
    interp: *const c_char,
    nfaces: c_int,
    nverts: *const c_int,
    verts: *const c_int,
) {
    take(this, "Mesh", |i| {
        let Some(n) = i.count("Mesh", nfaces) else { return };
        let made = values(nverts, n).and_then(|nverts| Some((nverts, values(verts, sum(nverts)?)?)));
        match made {
            Some((nverts, verts)) => i.mesh(string(interp), nverts.into(), verts.into()),
            None => i.refuse(
                "Mesh: its arrays are missing, or a face has a negative number of vertices".to_owned(),
            ),
        }
    });
}

extern "C" fn trim_curve(
    this: *mut c_void,
    nloops: c_int,
    ncurves: *const c_int,
    n: *const c_int,
    order: *const c_int,
    knot: *const f32,
    min: *const f32,
    max: *const f32,
    uvw: *const f32,
) {
    take(this, "TrimCurve", |i| {
        let Some(nloops) = i.count("TrimCurve", nloops) else { return };
        if nloops == 0 {
            return i.trim(None);
        }
        let made = (|| {
            let ncurves = values(ncurves, nloops)?;
            let curves = sum(ncurves)?;
            let (n, order) = (values(n, curves)?, values(order, curves)?);
            let points = sum(n)?;
            Some(TrimDesc {
                ncurves: ncurves.into(),
                n: n.into(),
                order: order.into(),
                knots: values(knot, points.checked_add(sum(order)?)?)?.into(),
                min: values(min, curves)?.into(),
                max: values(max, curves)?.into(),
                uvw: values(uvw, points.checked_mul(3)?)?.into(),
            })
        })();
        match made {
            Some(trim) => i.trim(Some(trim)),
            None => i.refuse("TrimCurve: its arrays are missing, or a number of them is negative".to_owned()),
        }
    });
}

extern "C" fn input_generator(this: *mut c_void, generator: *mut c_void, bound: *const f32) {
    // The renderer owns the generator in any case.
    let generator = GeneratorObject(generator);
    take(this, "Input", |i| {
        if generator.0.is_null() {
            return i.complain("Input: the generator is NULL");
        }
        let given = values(bound, if bound.is_null() { 0 } else { 6 }).and_then(|b| b.try_into().ok());
        let bound = match given {
            Some(bound) => Ok(Some(bound)),
            None => generator.bound(),
        };
        match bound {
            Ok(bound) => i.input(generator, bound),
            Err(what) => i.complain(format!("Input: the generator's {what}")),
        }
    });
}

extern "C" fn errors(this: *mut c_void) -> *mut Errors {
    // SAFETY: tables are called with the object that they belong to. Its manager never changes.
    unsafe { this.cast::<InterfaceObject<'_>>().as_ref() }
        .map_or(std::ptr::null_mut(), |object| object.errors.as_errors())
}

extern "C" fn destroy(this: *mut c_void) {
    // SAFETY: the owner of the table calls this once, at its end.
    let object = unsafe { Box::from_raw(this.cast::<InterfaceObject<'static>>()) };
    let errors = object.errors.clone();
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| drop(object))) {
        errors.reporter().error(format!("the end of a renderer failed: {}", crate::panic_text(&*panic)));
    }
}

impl Interface<'_> {
    /// Processes a program's own generator. It is kept when it has a bound and the host can keep it, else it is run.
    fn input(&mut self, generator: GeneratorObject, bound: Option<[f32; 6]>) {
        let generator = match bound {
            Some(_) => match self.host.keep(generator) {
                Ok(command) => return self.call(granita_scene::Call::Input { command, bound }),
                Err(generator) => generator,
            },
            None => generator,
        };
        let archives = self.host.archives();
        if archives {
            let levels = granita_scene::attr::LIMITS_INPUTLEVELS.ask(&*self.sink);
            if self.level >= levels {
                let within = bound.map_or_else(String::new, |b| format!(" within {b:?}"));
                let text = format!("Input: a generator of the program is run here{within}");
                return self.call(granita_scene::Call::Comment(text.into()));
            }
        }
        // A generator with a bound must not change the attribute state.
        let apart = archives && bound.is_some();
        if apart {
            self.call(granita_scene::Call::PushAttributes);
        }
        let sink = super::Borrowed(&mut *self.sink);
        let host: Box<dyn super::InterfaceHost> =
            if archives { Box::new(super::Archiving) } else { Box::new(()) };
        let mut inner = Interface::new(Box::new(sink), host, self.errors.clone(), self.at.clone());
        inner.level = self.level + 1;
        let object = InterfaceObject::new(inner, None);
        let result = object.run_generator(&generator, "");
        let stopped = object.into_inner().stopped();
        self.stopped |= stopped;
        if let Err(what) = result {
            self.complain(format!("Input: the generator's {what}"));
        }
        if apart {
            self.call(granita_scene::Call::PopAttributes);
        }
    }
}
