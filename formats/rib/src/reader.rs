// tidy: long: one match over the requests of RIB, with a short method for each
//! The reader. It executes requests and sends calls of the scene interface.

use crate::basis::Basis;
use crate::condition::{Branch, Value};
use crate::declare::{Declarations, Declared, Flaw, Given};
use crate::frame::{CAMERA, Options};
use crate::lex::Lexer;
use crate::quadrics;
use crate::recording::Archives;
use crate::request::{Arg, Request, Requests};
use granita_base::{BaseType, Files, Location, Param, ParamType, Params, Reporter, Severity, ShapeDesc};
use granita_scene::attribute::{AttributeValue, Key};
use granita_scene::{Call, GeneratorError, GeneratorSource, SceneSink, Stop, attr};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;

/// The largest number of calls that instances of objects may repeat, and of requests that stored archives may repeat.
pub(crate) const MAX_REPEATED: usize = 50_000_000;

/// The reason why a request has no result.
pub(crate) enum Fault {
    /// An error of the user, reported with its position.
    Mistake(String),
    /// An unsupported feature, reported once.
    Unsupported(String),
    /// The reading ends.
    Ends(GeneratorError),
}

impl From<Stop> for Fault {
    fn from(stop: Stop) -> Self {
        Self::Ends(GeneratorError::Stopped(stop))
    }
}

impl From<String> for Fault {
    fn from(text: String) -> Self {
        Self::Mistake(text)
    }
}

pub(crate) type Done = Result<(), Fault>;

/// A call and its position.
pub(crate) type Placed = (Call, Location);

/// The part of the attribute state that the scene interface does not have.
#[derive(Clone, Debug)]
pub(crate) struct Local {
    pub(crate) ubasis: Basis,
    pub(crate) vbasis: Basis,
    /// s and t at the four corners, set by `TextureCoordinates`.
    pub(crate) corners: Option<[f32; 8]>,
    /// True inside of `Detail`.
    pub(crate) detail: bool,
    /// True in a level of detail that is not shown, because a finer one is.
    pub(crate) coarse: bool,
}

impl Default for Local {
    fn default() -> Self {
        Self { ubasis: Basis::BEZIER, vbasis: Basis::BEZIER, corners: None, detail: false, coarse: false }
    }
}

/// The state of the world, which determines where calls go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// The world has not begun. Calls are stored.
    Before,
    /// A world of this source has begun.
    World,
    /// Another source began the world. This source is a part of a scene.
    Part,
    /// The world belongs to a frame that is not accepted. Calls are dropped.
    Dropped,
}

/// The state that `FrameBegin` saves.
struct Frame {
    options: Options,
    local: Local,
    lights: Lights,
    waiting: usize,
}

/// A block that is open.
struct Block {
    name: &'static str,
    line: u32,
    local: Local,
    /// The handles of lights before the world.
    lights: Option<Lights>,
}

/// The number of lights that each handle has been used for. A light of the interface stays on when its handle is used
/// again.
pub(crate) type Lights = BTreeMap<Arc<str>, usize>;

struct Motion {
    times: Vec<f32>,
    keys: Vec<Vec<Placed>>,
    line: u32,
}

pub(crate) struct Reader<'a> {
    sink: &'a mut dyn SceneSink,
    pub(crate) reporter: &'a Reporter,
    mode: Mode,
    /// True when the world began before this source.
    part: bool,
    /// The calls before `WorldBegin`.
    waiting: Vec<Placed>,
    pub(crate) options: Options,
    pub(crate) local: Local,
    pub(crate) declarations: Declarations,
    frames: Vec<Frame>,
    blocks: Vec<Block>,
    /// The number of worlds that have begun.
    worlds: usize,
    rendered: usize,
    motion: Option<Motion>,
    /// The object that is being defined, with its name, its calls and its line.
    object: Option<(Arc<str>, Vec<Placed>, u32)>,
    objects: BTreeMap<Arc<str>, Arc<[Placed]>>,
    pub(crate) repeated: usize,
    pub(crate) lights: Lights,
    /// The archives that are stored by the file itself.
    pub(crate) archives: Archives,
    /// The files that are being read, outermost first.
    pub(crate) files: Vec<PathBuf>,
    /// The opener of files.
    pub(crate) opens: Files,
    pub(crate) file: Arc<str>,
    pub(crate) line: u32,
    said: BTreeSet<String>,
    /// True when an error of the request is already known, so that further ones are not reported.
    pub(crate) quiet: bool,
    /// The conditionals that are being read, outermost first.
    pub(crate) branches: Vec<Branch>,
    /// The values of `Option "user"`, and of `Frame`.
    pub(crate) variables: BTreeMap<String, Value>,
    pub(crate) area_lights: usize,
    pub(crate) color_samples: Option<(usize, Vec<f32>)>,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(sink: &'a mut dyn SceneSink, reporter: &'a Reporter, name: &str) -> Self {
        let part = sink.in_world();
        Self {
            sink,
            reporter,
            mode: Mode::Before,
            part,
            waiting: Vec::new(),
            options: Options::default(),
            local: Local::default(),
            declarations: Declarations::default(),
            frames: Vec::new(),
            blocks: Vec::new(),
            worlds: 0,
            rendered: 0,
            motion: None,
            object: None,
            objects: BTreeMap::new(),
            repeated: 0,
            lights: Lights::new(),
            archives: Archives::default(),
            files: Vec::new(),
            opens: Files::default(),
            file: name.into(),
            line: 0,
            said: BTreeSet::new(),
            quiet: false,
            branches: Vec::new(),
            variables: BTreeMap::new(),
            area_lights: 0,
            color_samples: None,
        }
    }

    /// Reads a whole source.
    pub(crate) fn run(&mut self, source: &GeneratorSource) -> Result<(), GeneratorError> {
        let failed = |source_error| GeneratorError::Io { name: source.name(), source: source_error };
        self.opens = source.files().clone();
        let stream: Box<dyn Read> = match source {
            GeneratorSource::File { path, .. } => {
                self.files.push(std::fs::canonicalize(path).unwrap_or_else(|_| path.clone()));
                Box::new(self.opens.open(path).map_err(failed)?)
            }
            GeneratorSource::Bytes { bytes, .. } => Box::new(io::Cursor::new(bytes.clone())),
        };
        let result = self.stream(stream);
        match result {
            Ok(()) => self.end(),
            Err(Fault::Ends(error)) => Err(error),
            Err(Fault::Mistake(text) | Fault::Unsupported(text)) => Err(GeneratorError::Malformed(text)),
        }
    }

    /// Reads the requests of one file.
    pub(crate) fn stream(&mut self, stream: Box<dyn Read>) -> Done {
        let io = |file: &Arc<str>, line: u32, error: io::Error| {
            Fault::Ends(GeneratorError::Malformed(format!("{file}:{line}: {error}")))
        };
        let stream = decompressed(stream).map_err(|e| io(&self.file, 1, e))?;
        let mut requests = Requests::new(Lexer::new(stream));
        loop {
            let request = match requests.next() {
                Ok(Some(request)) => request,
                Ok(None) => return Ok(()),
                Err(error) => return Err(io(&self.file, requests.line(), error)),
            };
            self.line = request.line;
            let Some(request) = self.recorded(request) else { continue };
            self.perform(request)?;
        }
    }

    /// Executes one request. Returns only errors that end the reading. Others are reported.
    pub(crate) fn perform(&mut self, request: Request) -> Done {
        // An error in the text of the request is the cause of all other errors.
        self.quiet = request.mistake.is_some();
        let done = self.branch(&request).unwrap_or_else(|| self.request(&request));
        self.quiet = false;
        match (done, request.mistake) {
            (Err(ends @ Fault::Ends(_)), _) => return Err(ends),
            (Err(Fault::Unsupported(text)), None) => self.once(text),
            (Ok(()), None) => (),
            (Ok(()), Some(mistake)) => self.error(format!("{}: {mistake}", request.name)),
            (Err(Fault::Mistake(text) | Fault::Unsupported(text)), mistake) => {
                let text = mistake.unwrap_or(text);
                let object = self.object_name();
                self.error(format!("{}: {text}: the request is left out{object}", request.name));
            }
        }
        Ok(())
    }

    /// Processes the end of the source.
    fn end(&mut self) -> Result<(), GeneratorError> {
        if let Some(motion) = self.motion.take() {
            self.line = motion.line;
            self.error("MotionBegin without MotionEnd".to_owned());
        }
        if let Some((_, _, line)) = self.object.take() {
            self.line = line;
            self.error("ObjectBegin without ObjectEnd".to_owned());
        }
        if let Some(line) = self.archives.unfinished() {
            self.line = line;
            self.error("ArchiveBegin without ArchiveEnd".to_owned());
        }
        if let Some(branch) = self.branches.first() {
            self.line = branch.line;
            self.error("IfBegin without IfEnd".to_owned());
        }
        while let Some(block) = self.blocks.pop() {
            self.line = block.line;
            let frame = if block.name == "WorldBegin" { ": the frame is not rendered" } else { "" };
            self.error(format!("{0} without {1}{frame}", block.name, block.name.replace("Begin", "End")));
        }
        if self.mode == Mode::Before && self.worlds == 0 {
            // The source holds settings for a scene, or a part of one without geometry.
            let (calls, at) = (self.frame_calls(), self.at());
            if !self.part {
                for call in calls {
                    self.sink.call(call, &at)?;
                }
            }
            self.flush(|_| true)?;
        }
        Ok(())
    }

    pub(crate) fn at(&self) -> Location {
        Location::line(&self.file, self.line)
    }

    /// Returns ` (object "name")`, or an empty string.
    fn object_name(&self) -> String {
        match &*attr::NAME.ask(self.sink) {
            name if self.in_world() && !name.is_empty() => format!(" (object \"{name}\")"),
            _ => String::new(),
        }
    }

    pub(crate) fn error(&self, text: String) {
        if self.quiet {
            return;
        }
        self.reporter.say(Severity::Error, &self.at(), text);
    }

    /// Reports a warning, once per text.
    pub(crate) fn once(&mut self, text: String) {
        if self.said.len() < 10_000 && self.said.insert(text.clone()) {
            self.reporter.say(Severity::Warning, &self.at(), text);
        }
    }

    /// Returns the parameters of a request from argument `from` on.
    pub(crate) fn params(&mut self, request: &Request, from: usize) -> Vec<Given> {
        let mut wrong = Vec::new();
        let args = request.args.get(from..).unwrap_or_default();
        let list = self.declarations.list(args, &mut |flaw| wrong.push(flaw), &|_, _| None);
        for Flaw::Undeclared(text) | Flaw::Mistake(text) in wrong {
            self.error(format!("{}: {text}", request.name));
        }
        list
    }

    /// Returns the parameters like [`Self::params`], for requests whose parameters each renderer chooses. An undeclared
    /// parameter has the type of its values where `knows` accepts its name, and is left out with a warning otherwise.
    pub(crate) fn own_params(
        &mut self,
        request: &Request,
        from: usize,
        knows: &dyn Fn(&str) -> bool,
    ) -> Vec<Given> {
        let mut wrong = Vec::new();
        let args = request.args.get(from..).unwrap_or_default();
        let typed = |name: &str, values: &Arg| Declared::of_values(values).filter(|_| knows(name));
        let list = self.declarations.list(args, &mut |flaw| wrong.push(flaw), &typed);
        for flaw in wrong {
            match flaw {
                Flaw::Undeclared(text) => self.once(format!("{}: {text}", request.name)),
                Flaw::Mistake(text) => self.error(format!("{}: {text}", request.name)),
            }
        }
        list
    }

    /// Sends a call, or stores it where it belongs, which is a motion key, an object, or the calls before the world.
    pub(crate) fn emit(&mut self, call: Call) -> Done {
        let at = self.at();
        if let Some(key) = self.motion.as_mut().and_then(|m| m.keys.last_mut()) {
            key.push((call, at));
            return Ok(());
        }
        self.send(call, at)
    }

    fn send(&mut self, call: Call, at: Location) -> Done {
        if self.local.detail && self.local.coarse && matches!(call, Call::Shape { .. } | Call::Input { .. }) {
            return Ok(());
        }
        if let Some((_, calls, _)) = &mut self.object {
            calls.push((call, at));
            return Ok(());
        }
        match self.mode {
            Mode::Dropped => Ok(()),
            Mode::World | Mode::Part => Ok(self.sink.call(call, &at)?),
            Mode::Before => {
                let shape = matches!(call, Call::Shape { .. } | Call::Input { .. });
                if shape && self.part {
                    // Geometry without a world of its own is a part of another scene.
                    self.mode = Mode::Part;
                    self.flush(|_| true)?;
                    return Ok(self.sink.call(call, &at)?);
                }
                if shape {
                    return Err(Fault::Mistake("geometry outside of WorldBegin and WorldEnd".to_owned()));
                }
                if matches!(call, Call::Command { .. }) {
                    return Ok(self.sink.call(call, &at)?);
                }
                self.waiting.push((call, at));
                Ok(())
            }
        }
    }

    /// Sends the wanted calls among those before the world.
    fn flush(&mut self, wanted: impl Fn(&Call) -> bool) -> Result<(), Stop> {
        for (call, at) in &self.waiting {
            if wanted(call) {
                self.sink.call(call.clone(), at)?;
            }
        }
        Ok(())
    }

    pub(crate) fn attribute<S, T: AttributeValue>(&mut self, key: Key<S, T>, value: T) -> Done {
        self.emit(Call::Attribute(key.param(value)))
    }

    pub(crate) fn shape(&mut self, shape: ShapeDesc, params: Params) -> Done {
        self.emit(Call::Shape { shape: Box::new(shape), params })
    }

    fn frame_calls(&mut self) -> Vec<Call> {
        let mut wrong = Vec::new();
        let known = |name: &str| {
            crate::frame::shading_variable(name).or_else(|| self.declarations.find(name).map(|(d, _)| d))
        };
        let calls = self.options.calls(&known, &mut |text| wrong.push(text));
        wrong.into_iter().for_each(|text| self.once(text));
        calls
    }

    /// Removes the transformations of this frame from the calls before the world. Returns true when there were any.
    pub(crate) fn forget_transforms(&mut self) -> bool {
        let from = self.frames.last().map_or(0, |f| f.waiting).min(self.waiting.len());
        let rest = self.waiting.split_off(from);
        let n = rest.len();
        let moves = |call: &Call| {
            matches!(
                call,
                Call::Translate(_)
                    | Call::Rotate { .. }
                    | Call::Scale(_)
                    | Call::AppendTransform(_)
                    | Call::SetTransform(_)
                    | Call::Motion(_)
            )
        };
        self.waiting.extend(rest.into_iter().filter(|(call, _)| !moves(call)));
        self.waiting.len() < from + n
    }

    /// Returns an attribute, which may be among the calls before the world.
    pub(crate) fn attribute_value(&self, name: &str) -> Option<Param> {
        let waits = self.waiting.iter().rev().find_map(|(call, _)| match call {
            Call::Attribute(param) if &*param.name == name => Some(param.clone()),
            _ => None,
        });
        waits.or_else(|| self.sink.attribute(name))
    }

    pub(crate) fn in_world(&self) -> bool {
        matches!(self.mode, Mode::World | Mode::Dropped | Mode::Part)
    }

    /// Executes structural requests such as `FrameBegin` and `WorldBegin`. Returns `None` for other requests.
    pub(crate) fn structure(&mut self, request: &Request) -> Option<Done> {
        Some(match request.name.as_str() {
            "FrameBegin" => {
                let (options, local) = (self.options.clone(), self.local.clone());
                if let Some(number) = request.args.first().and_then(|a| a.floats()?.first().copied()) {
                    self.variables.insert("Frame".to_owned(), Value::Number(f64::from(number)));
                }
                let (lights, waiting) = (self.lights.clone(), self.waiting.len());
                self.frames.push(Frame { options, local, lights, waiting });
                Ok(())
            }
            "FrameEnd" => self.frame_end(),
            "WorldBegin" => self.world_begin(),
            "WorldEnd" => self.world_end(),
            "AttributeBegin" => self.begin("AttributeBegin", Call::PushAttributes),
            "SolidBegin" => {
                let operation = request.args.first().and_then(|a| a.strings()?.first().cloned());
                if operation.is_none_or(|o| &*o != "primitive") {
                    self.once("SolidBegin: solids are not computed; all of their parts are shown".to_owned());
                }
                self.begin("AttributeBegin", Call::PushAttributes)
            }
            "AttributeEnd" | "SolidEnd" => self.finish("AttributeBegin", Call::PopAttributes),
            "TransformBegin" => self.begin("TransformBegin", Call::PushTransform),
            "TransformEnd" => self.finish("TransformBegin", Call::PopTransform),
            "MotionBegin" => self.motion_begin(request),
            "MotionEnd" => self.motion_end(),
            "ObjectBegin" => self.object_begin(request),
            "ObjectEnd" => match self.object.take() {
                Some((name, calls, _)) => {
                    self.objects.insert(name, calls.into());
                    Ok(())
                }
                None => Err(Fault::Mistake("without ObjectBegin".to_owned())),
            },
            "ObjectInstance" => self.instance(request),
            "ReadArchive" => self.archive(request),
            "ArchiveBegin" => self.archive_begin(request),
            "ArchiveEnd" => self.archive_end(),
            _ => return None,
        })
    }

    fn frame_end(&mut self) -> Done {
        if self.blocks.iter().any(|b| b.name == "WorldBegin") {
            self.error("FrameEnd: WorldBegin without WorldEnd".to_owned());
            self.world_end()?;
        }
        let Some(frame) = self.frames.pop() else {
            return Err(Fault::Mistake("without FrameBegin".to_owned()));
        };
        self.options = frame.options;
        self.local = frame.local;
        self.lights = frame.lights;
        self.waiting.truncate(frame.waiting);
        Ok(())
    }

    fn world_begin(&mut self) -> Done {
        if self.in_world() {
            return Err(Fault::Mistake("inside of a world".to_owned()));
        }
        let (local, lights) = (self.local.clone(), Some(self.lights.clone()));
        let block = Block { name: "WorldBegin", line: self.line, local, lights };
        self.worlds += 1;
        let at = self.at();
        if self.part {
            self.once(
                "WorldBegin: the scene has a world already; camera and options are left out".to_owned(),
            );
            self.sink.call(Call::PushAttributes, &at)?;
            // The transformations before it positioned the camera.
            self.flush(|call| {
                matches!(call, Call::Attribute(_) | Call::Shader { .. } | Call::LightSwitch { .. })
            })?;
        } else {
            if self.rendered > 0 && !self.sink.new_frame() {
                self.once("WorldBegin: only one frame can be read; later ones are left out".to_owned());
                self.mode = Mode::Dropped;
                self.blocks.push(block);
                return Ok(());
            }
            for call in self.frame_calls() {
                self.sink.call(call, &at)?;
            }
            self.flush(|_| true)?;
            self.sink.call(Call::World, &at)?;
        }
        self.mode = Mode::World;
        self.blocks.push(block);
        Ok(())
    }

    fn world_end(&mut self) -> Done {
        let Some(start) = self.blocks.iter().position(|b| b.name == "WorldBegin") else {
            return Err(Fault::Mistake("without WorldBegin".to_owned()));
        };
        if let Some(motion) = self.motion.take() {
            self.error(format!("WorldEnd: MotionBegin of line {} without MotionEnd", motion.line));
        }
        if let Some((_, _, line)) = self.object.take() {
            self.error(format!("WorldEnd: ObjectBegin of line {line} without ObjectEnd"));
        }
        for block in self.blocks.split_off(start + 1) {
            let end = block.name.replace("Begin", "End");
            self.error(format!("WorldEnd: {} of line {} without {end}", block.name, block.line));
            let call = if block.name == "AttributeBegin" { Call::PopAttributes } else { Call::PopTransform };
            self.send_now(call)?;
        }
        if let Some(block) = self.blocks.pop() {
            self.local = block.local;
            self.lights = block.lights.unwrap_or_default();
        }
        let dropped = self.mode == Mode::Dropped;
        if self.part {
            self.send_now(Call::PopAttributes)?;
        } else if !dropped {
            self.send_now(Call::Render { camera: Some(CAMERA.into()) })?;
            self.rendered += 1;
        }
        self.mode = Mode::Before;
        Ok(())
    }

    fn send_now(&mut self, call: Call) -> Done {
        let at = self.at();
        if self.mode != Mode::Dropped {
            self.sink.call(call, &at)?;
        }
        Ok(())
    }

    fn begin(&mut self, name: &'static str, call: Call) -> Done {
        if self.blocks.len() > 100_000 {
            return Err(Fault::Mistake("blocks are nested too deep".to_owned()));
        }
        self.blocks.push(Block { name, line: self.line, local: self.local.clone(), lights: None });
        self.emit(call)
    }

    fn finish(&mut self, name: &'static str, call: Call) -> Done {
        match self.blocks.last() {
            Some(block) if block.name == name => {}
            Some(block) if block.name != "WorldBegin" => {
                let (open, line) = (block.name, block.line);
                return Err(Fault::Mistake(format!("{open} of line {line} is still open")));
            }
            _ => return Err(Fault::Mistake(format!("without {name}"))),
        }
        if let Some(block) = self.blocks.pop()
            && name == "AttributeBegin"
        {
            self.local = block.local;
        }
        self.emit(call)
    }

    fn motion_begin(&mut self, request: &Request) -> Done {
        if self.motion.is_some() {
            return Err(Fault::Mistake("inside of MotionBegin".to_owned()));
        }
        let times: Vec<f32> = request.args.iter().filter_map(Arg::floats).flat_map(|f| f.to_vec()).collect();
        if times.is_empty() {
            return Err(Fault::Mistake("no times".to_owned()));
        }
        self.motion = Some(Motion { times, keys: Vec::new(), line: self.line });
        Ok(())
    }

    /// True when a motion block is open.
    pub(crate) fn moves(&self) -> bool {
        self.motion.is_some()
    }

    /// Begins a key. In a motion block, each request is a key.
    fn next_key(&mut self) {
        if let Some(motion) = &mut self.motion {
            motion.keys.push(Vec::new());
        }
    }

    fn motion_end(&mut self) -> Done {
        let Some(Motion { times, mut keys, .. }) = self.motion.take() else {
            return Err(Fault::Mistake("without MotionBegin".to_owned()));
        };
        keys.retain(|key| !key.is_empty());
        if keys.is_empty() {
            return Ok(());
        }
        if keys.len() != times.len() {
            let text = format!("{} times, but {} requests between", times.len(), keys.len());
            self.error(format!("MotionEnd: {text}; the first one is used without motion"));
            keys.truncate(1);
        }
        let moves = |call: &Call| {
            matches!(
                call,
                Call::Shape { .. }
                    | Call::Translate(_)
                    | Call::Rotate { .. }
                    | Call::Scale(_)
                    | Call::AppendTransform(_)
                    | Call::SetTransform(_)
            )
        };
        let n = keys[0].len();
        if keys.iter().any(|k| k.len() != n || !k.iter().all(|(call, _)| moves(call))) {
            self.once(
                "MotionBegin: only transformations and geometry of one kind move; the first one is used without motion"
                    .to_owned(),
            );
            keys.truncate(1);
        }
        for i in 0..n {
            let mut column: Vec<Placed> = keys.iter().map(|k| k[i].clone()).collect();
            if column.len() == 1 {
                let (call, at) = column.swap_remove(0);
                self.send(call, at)?;
                continue;
            }
            swell(&mut column);
            let at = self.at();
            self.send(Call::Motion(times.as_slice().into()), at)?;
            for (call, at) in column {
                self.send(call, at)?;
            }
        }
        Ok(())
    }

    fn object_begin(&mut self, request: &Request) -> Done {
        let name = handle(request.args.first()).ok_or_else(|| "no name".to_owned())?;
        if self.object.is_some() {
            return Err(Fault::Mistake("inside of ObjectBegin".to_owned()));
        }
        self.object = Some((name, Vec::new(), self.line));
        Ok(())
    }

    fn instance(&mut self, request: &Request) -> Done {
        let name = handle(request.args.first()).ok_or_else(|| "no name".to_owned())?;
        if self.object.is_some() {
            return Err(Fault::Mistake("inside of ObjectBegin".to_owned()));
        }
        let Some(calls) = self.objects.get(&name).cloned() else {
            return Err(Fault::Mistake(format!("there is no object \"{name}\"")));
        };
        self.repeated = self.repeated.saturating_add(calls.len());
        if self.repeated > MAX_REPEATED {
            return Err(Fault::Mistake(format!("instances repeat more than {MAX_REPEATED} calls")));
        }
        self.emit(Call::PushAttributes)?;
        for (call, at) in calls.iter() {
            self.send(call.clone(), at.clone())?;
        }
        self.emit(Call::PopAttributes)
    }

    fn request(&mut self, request: &Request) -> Done {
        if let Some(done) = self.structure(request) {
            return done;
        }
        self.next_key();
        let groups = [
            Self::option_request,
            Self::attribute_request,
            Self::transform_request,
            Self::shader_request,
            Self::geometry_request,
            Self::texture_request,
        ];
        for group in groups {
            if let Some(done) = group(self, request) {
                return done;
            }
        }
        if request.name.is_empty() {
            return Err(Fault::Mistake("arguments without a request".to_owned()));
        }
        let text = format!("unknown request {}", request.name);
        if self.said.len() < 10_000 && self.said.insert(text.clone()) {
            let known = crate::names::REQUESTS;
            let hint = granita_base::suggestion(&request.name, known);
            let hint = hint.map(|name| format!("; did you mean \"{name}\"?")).unwrap_or_default();
            self.error(format!("{text}{hint}: it is left out"));
        }
        Ok(())
    }

    /// Returns the state that a source which is read later needs, as requests.
    pub(crate) fn inherited(&self) -> String {
        let mut text = self.declarations.requests();
        if let Some(corners) = &self.local.corners {
            text += &format!("TextureCoordinates [{}] ", corners.map(|c| c.to_string()).join(" "));
        }
        let (u, v) = (&self.local.ubasis, &self.local.vbasis);
        if *u != Basis::BEZIER || *v != Basis::BEZIER {
            let matrix =
                |b: &Basis| b.matrix.as_flattened().iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
            text += &format!("Basis [{}] {} [{}] {} ", matrix(u), u.step, matrix(v), v.step);
        }
        text
    }
}

/// Converts a sphere whose arguments change to a patch at each time.
fn swell(keys: &mut [Placed]) {
    let shapes: Vec<&ShapeDesc> = keys
        .iter()
        .filter_map(|(call, _)| match call {
            Call::Shape { shape, .. } => Some(&**shape),
            _ => None,
        })
        .collect();
    let spheres = shapes.iter().all(|s| matches!(s, ShapeDesc::Sphere { .. })) && !shapes.is_empty();
    if !spheres || shapes.windows(2).all(|w| w[0] == w[1]) {
        return;
    }
    for (call, _) in keys {
        let Call::Shape { shape, params } = call else { continue };
        let ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } = **shape else { continue };
        let arguments = [radius, zmin, zmax, thetamax_deg].map(f64::from);
        let (patch, pw) = quadrics::sphere(arguments);
        **shape = patch;
        params.set(pw);
    }
}

/// Returns a handle, which is a number or a name.
pub(crate) fn handle(arg: Option<&Arg>) -> Option<Arc<str>> {
    match arg? {
        Arg::Int(i) => Some(i.to_string().into()),
        Arg::Float(f) => Some(f.to_string().into()),
        other => other.strings()?.first().cloned(),
    }
}

/// Returns a parameter of the scene interface that is neither an array nor interpolated.
pub(crate) fn plain(name: &str, base: BaseType, data: impl Into<granita_base::ParamData>) -> Param {
    Param { name: name.into(), ty: ParamType::of(base), data: data.into() }
}

/// Returns the stream, decompressed when it is compressed by gzip.
fn decompressed(mut stream: Box<dyn Read>) -> io::Result<Box<dyn Read>> {
    let mut head = Vec::with_capacity(2);
    stream.by_ref().take(2).read_to_end(&mut head)?;
    let compressed = head == [0x1f, 0x8b];
    let whole = io::Cursor::new(head).chain(stream);
    Ok(if compressed {
        Box::new(flate2::read::MultiGzDecoder::new(io::BufReader::new(whole)))
    } else {
        Box::new(whole)
    })
}
