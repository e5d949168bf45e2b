//! Everything that a scene reads, copied into one folder (`-pack`).
//!
//! Files beneath the current folder keep their names. Others are beneath a folder "files", by their whole paths. The
//! list ([`PackList`]) says which folders are elsewhere, so that no text of a scene or a shader needs to change.

use crate::listing::assets;
use crate::packed::{LIST, PackList, PackedFile};
use granita_base::files::{is_same_file, without_dots};
use granita_base::{Environment, Reporter, Supervisor};
use granita_cli::Status;
use granita_farm::{FrameRange, numbered};
use granita_session::{AssetKind, Assets, NetSecret, SessionOptions};
use sha1::{Digest, Sha1};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Component, Path, PathBuf};

/// The largest file that is searched for the names of variables, in bytes.
const LARGEST: u64 = 64 << 20;

/// Packs scene files, of the frames of a range where there is one.
pub(crate) fn run(
    options: SessionOptions,
    files: &[String],
    frames: Option<&FrameRange>,
    into: &Path,
    (supervisor, reporter): (&Supervisor, &Reporter),
) -> Status {
    let result = packed(options, files, frames, into, (supervisor, reporter));
    match result {
        Ok(list) => {
            let bytes: u64 = list.files.iter().map(|file| file.bytes).sum();
            let names: Vec<&str> = list.scene.iter().map(String::as_str).collect();
            for name in &list.missing {
                reporter.warning(format!("-pack: \"{name}\" is the name of no file"));
            }
            for command in &list.commands {
                reporter.warning(format!(
                    "-pack: the scene runs \"{command}\", whose files are not known; those that its words name are packed"
                ));
            }
            let text = format!(
                "{} files, {bytes} bytes; render: gelato -cwd {} {}\n",
                list.files.len(),
                into.display(),
                names.join(" ")
            );
            // A reader that is gone has the folder all the same.
            let _ = std::io::stdout().write_all(text.as_bytes());
            Status::Done
        }
        Err(what) => {
            reporter.error(format!("-pack {}: {what}", into.display()));
            Status::Failed
        }
    }
}

fn packed(
    options: SessionOptions,
    files: &[String],
    frames: Option<&FrameRange>,
    into: &Path,
    (supervisor, reporter): (&Supervisor, &Reporter),
) -> Result<PackList, String> {
    let here = options.current_folder.clone();
    if options.run.environment.files().moved().is_some() {
        return Err(format!("the current folder is a packed one already ({LIST})"));
    }
    let is_free = match std::fs::read_dir(into) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) => error.kind() == std::io::ErrorKind::NotFound,
    };
    if !is_free {
        return Err("it exists, and is not an empty folder".to_owned());
    }
    let (variables, plugins) = (options.run.environment.clone(), options.run.plugins.clone());
    let assets = of_frames(options, files, frames, reporter)?;
    let mut plan = Plan::new(here, &assets, &variables);
    for (path, kind) in &assets.read {
        plan.add(path, *kind, reporter)?;
    }
    let (mut list, folders) = plan.list(&assets, files, &variables);
    list.plugins = plugins.into_iter().filter(|name| plan.has_plugin(name)).collect();
    let parent = match into.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let at_parent = |error: std::io::Error| format!("{}: {error}", parent.display());
    // The folder appears under its name when it is whole.
    let part = tempfile::Builder::new().prefix(".gelato-pack-").tempdir_in(parent).map_err(at_parent)?;
    for file in &mut list.files {
        if supervisor.has_ended() {
            return Err("it was ended early, and nothing was written".to_owned());
        }
        let to = part.path().join(&file.name);
        copy(file, &to)?;
    }
    for folder in &folders {
        make(&part.path().join(folder))?;
    }
    let text = serde_json::to_string_pretty(&list).map_err(|error| error.to_string())? + "\n";
    let file = part.path().join(LIST);
    std::fs::write(&file, text).map_err(|error| format!("{}: {error}", file.display()))?;
    finish(part, into)?;
    Ok(list)
}

/// Puts a complete folder under its name.
fn finish(part: tempfile::TempDir, into: &Path) -> Result<(), String> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary folders are private.
        std::fs::set_permissions(part.path(), std::fs::Permissions::from_mode(0o755))
            .map_err(|error| error.to_string())?;
    }
    // An empty folder of that name gives way. Where it cannot, renaming reports the reason.
    let _ = std::fs::remove_dir(into);
    std::fs::rename(part.path(), into).map_err(|error| error.to_string())?;
    let _ = part.keep();
    Ok(())
}

/// Returns the files of all frames.
fn of_frames(
    options: SessionOptions,
    files: &[String],
    frames: Option<&FrameRange>,
    reporter: &Reporter,
) -> Result<Assets, String> {
    let list = |options: SessionOptions, files: &[String]| {
        let assets = assets(options, files, true, reporter).map_err(|error| error.to_string())?;
        match reporter.errors() {
            0 => Ok(assets),
            n => Err(format!("the scene has errors ({n}), and nothing was written")),
        }
    };
    let Some(frames) = frames else { return list(options, files) };
    let mut all = Assets::default();
    for number in frames.numbers() {
        let mut options = options.clone();
        options.number = Some(*number);
        options.run.environment.set("frame", number.to_string());
        options.run.program_environment.push(("frame".to_owned(), number.to_string()));
        let files: Vec<String> = files.iter().map(|name| numbered(name, *number)).collect();
        options.scene_files.clone_from(&files);
        for output in &mut options.extra_outputs {
            output.name = numbered(&output.name, *number);
        }
        let assets = list(options, &files).map_err(|what| format!("frame {number}: {what}"))?;
        all.read.extend(assets.read);
        all.written.extend(assets.written);
        all.missing.extend(assets.missing);
        let commands = assets.commands.into_iter().filter(|command| !all.commands.contains(command));
        let commands: Vec<String> = commands.collect();
        all.commands.extend(commands);
    }
    all.forget_made();
    Ok(all)
}

/// Where files are going to be.
struct Plan {
    /// The current folder.
    here: PathBuf,
    /// The folder of files that are not beneath the current one. No file beneath the current one has this name.
    top: String,
    /// The folder of the program's own files, which are not packed.
    home: Option<PathBuf>,
    /// The names of startup files, in the order of reading.
    startup: Vec<PathBuf>,
    /// The places of files, and the files with their kinds.
    files: BTreeMap<PathBuf, (PathBuf, AssetKind)>,
}

impl Plan {
    fn new(here: PathBuf, assets: &Assets, variables: &Environment) -> Self {
        let folder = |name| variables.get(name).filter(|folder: &&str| !folder.is_empty());
        let [home, user] =
            ["GELATOHOME", "HOME"].map(|name| folder(name).map(|folder| without_dots(&here.join(folder))));
        let startup = home.iter().chain(&user).map(|folder| folder.join(".gelato.pyg")).collect();
        // A home that contains the scene is a checkout, whose files are those of the scene.
        let home = home.filter(|home| !here.starts_with(home));
        let first = |path: &PathBuf| {
            let whole = without_dots(&here.join(path));
            let first = whole.strip_prefix(&here).ok()?.components().next()?;
            Some(first.as_os_str().to_string_lossy().to_lowercase())
        };
        let used: BTreeSet<String> = assets.read.keys().chain(&assets.written).filter_map(first).collect();
        let names = (1..).map(|n| if n == 1 { "files".to_owned() } else { format!("files{n}") });
        let top = names.into_iter().find(|name| !used.contains(name)).unwrap_or_default();
        Self { here, top, home, startup, files: BTreeMap::new() }
    }

    /// Adds a file that the scene reads.
    fn add(&mut self, path: &Path, kind: AssetKind, reporter: &Reporter) -> Result<(), String> {
        let whole = without_dots(&self.here.join(path));
        let (name, is_here) = (path.display(), whole.starts_with(&self.here));
        let is_of_program = self.home.as_ref().is_some_and(|home| whole.starts_with(home));
        // Names in brackets are of texts inside of the program.
        if is_of_program && !self.startup.contains(&whole) || !path.is_file() {
            if kind == AssetKind::Plugin {
                reporter
                    .warning(format!("-pack: the plugin {name} is a file of $GELATOHOME, and not packed"));
            }
            return Ok(());
        }
        let opener = match kind {
            AssetKind::Script => "scripts",
            AssetKind::Program => "commands",
            _ => "",
        };
        if !is_here && !opener.is_empty() {
            reporter.warning(format!(
                "-pack: {name} is packed, but {opener} look for it at its old place; name it relative to the scene's folder"
            ));
        }
        if path.components().any(|part| part == Component::ParentDir) && !is_same_file(path, &whole) {
            return Err(format!("{}: its \"..\" follows a link; name the file without it", path.display()));
        }
        let place = self.place(&whole);
        if place == Path::new(LIST) {
            return Err(format!("the scene reads a file with the name of the list, {LIST}"));
        }
        self.files.insert(place, (whole, kind));
        Ok(())
    }

    /// True when a plugin is packed that has this name, or is in the folder of this name.
    fn has_plugin(&self, name: &Path) -> bool {
        let named = without_dots(&self.here.join(name));
        let is_it = |whole: &Path| whole == named || whole.parent() == Some(&named);
        self.files.values().any(|(whole, kind)| *kind == AssetKind::Plugin && is_it(whole))
    }

    /// Returns the place of an absolute file or folder.
    fn place(&self, whole: &Path) -> PathBuf {
        if let Ok(name) = whole.strip_prefix(&self.here) {
            return name.to_owned();
        }
        let mut place = PathBuf::from(&self.top);
        for part in whole.components() {
            match part {
                Component::Normal(name) => place.push(name),
                // "C:" of Windows.
                Component::Prefix(drive) => {
                    place.push(drive.as_os_str().to_string_lossy().replace([':', '\\', '?'], ""));
                }
                _ => (),
            }
        }
        place
    }

    /// Returns the list, without sizes and hashes, and the folders of images.
    fn list(
        &self,
        assets: &Assets,
        files: &[String],
        variables: &Environment,
    ) -> (PackList, BTreeSet<PathBuf>) {
        let mut list = PackList::new(self.here.clone());
        list.scene = files.iter().map(|name| self.scene_name(name)).collect();
        list.commands.clone_from(&assets.commands);
        list.missing = assets.missing.iter().cloned().collect();
        list.outputs = assets.written.iter().map(|path| path.to_string_lossy().into_owned()).collect();
        let mut folders = BTreeSet::new();
        let outputs: Vec<PathBuf> =
            assets.written.iter().map(|path| without_dots(&self.here.join(path))).collect();
        for folder in outputs.iter().filter_map(|path| path.parent()).filter(|folder| folder.is_dir()) {
            folders.insert(self.place(folder));
        }
        let wholes = self.files.values().map(|(whole, _)| whole);
        for folder in wholes.chain(&outputs).filter_map(|whole| whole.parent()) {
            list.moved.insert(folder.to_owned(), slashes(&self.place(folder)));
        }
        let startup = self.startup.iter().map(|whole| self.place(whole));
        list.startup =
            startup.filter(|place| self.files.contains_key(place)).map(|place| slashes(&place)).collect();
        list.variables = self.variables(variables);
        for (place, (whole, kind)) in &self.files {
            list.files.push(PackedFile {
                name: slashes(place),
                from: whole.clone(),
                kind: kind.name().to_owned(),
                bytes: 0,
                sha1: String::new(),
            });
        }
        (list, folders)
    }

    /// Returns the name of a scene file in the folder. Other inputs, such as programs, keep their words.
    fn scene_name(&self, name: &str) -> String {
        let whole = without_dots(&self.here.join(name));
        let place = self.place(&whole);
        // The number of a frame may stand in the name.
        let is_packed = self.files.contains_key(&place) || granita_farm::has_number(name);
        if is_packed { slashes(&place) } else { name.to_owned() }
    }

    /// Returns the variables that scene files and shaders name, and those of inputs ("PYG_...").
    fn variables(&self, variables: &Environment) -> BTreeMap<String, String> {
        let mut named = BTreeSet::new();
        for (whole, kind) in self.files.values() {
            let is_small = whole.metadata().is_ok_and(|data| data.len() <= LARGEST);
            let is_text = !matches!(kind, AssetKind::Texture | AssetKind::Plugin);
            if is_text && is_small {
                // A file that cannot be read is reported when it is copied.
                let bytes = std::fs::read(whole).unwrap_or_default();
                names_after_marks(&String::from_utf8_lossy(&bytes), &mut named);
            }
        }
        let is_own = |name: &str| ["GELATOHOME", "HOME", "frame", NetSecret::VARIABLE].contains(&name);
        let is_used = |name: &str| !is_own(name) && (named.contains(name) || name.starts_with("PYG_"));
        let used = variables.iter().filter(|(name, _)| is_used(name));
        used.map(|(name, value)| (name.to_owned(), value.to_owned())).collect()
    }
}

/// Adds the names of variables in a text: `$NAME`, `${NAME}`, `$(NAME)` and `%NAME%`.
fn names_after_marks(text: &str, names: &mut BTreeSet<String>) {
    for (at, _) in text.match_indices(['$', '%']) {
        let rest = text[at + 1..].trim_start_matches(['{', '(']);
        let length = rest.bytes().take_while(|c| c.is_ascii_alphanumeric() || *c == b'_').count();
        if length > 0 {
            names.insert(rest[..length].to_owned());
        }
    }
}

/// Returns a name with "/" between its parts, on every system.
fn slashes(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts.join("/")
}

fn make(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Copies a file, with its time, and notes its size and its hash.
fn copy(file: &mut PackedFile, to: &Path) -> Result<(), String> {
    if let Some(folder) = to.parent() {
        make(folder)?;
    }
    let from = file.from.display().to_string();
    let mut copied = || -> std::io::Result<()> {
        let (mut source, mut target) = (File::open(&file.from)?, File::create_new(to)?);
        let mut hash = Sha1::new();
        let mut room = vec![0; 1 << 16];
        loop {
            let n = source.read(&mut room)?;
            if n == 0 {
                break;
            }
            hash.update(&room[..n]);
            target.write_all(&room[..n])?;
            file.bytes += n as u64;
        }
        let data = source.metadata()?;
        target.set_permissions(data.permissions())?;
        // A file system without times keeps none.
        let _ = data.modified().and_then(|time| target.set_modified(time));
        file.sha1 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        target.sync_all()
    };
    copied().map_err(|error| format!("{from}: {error}"))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;

    #[test]
    fn variables_are_found_in_all_their_forms() {
        let mut names = BTreeSet::new();
        names_after_marks("a/$ONE/${TWO}x:$(THREE):%FOUR%: 100 % $ ${ é$FIVE$", &mut names);
        // The text between two marks counts as well, which costs nothing.
        for name in ["ONE", "TWO", "THREE", "FOUR", "FIVE"] {
            assert!(names.contains(name), "{names:?}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn files_have_places_of_their_own() {
        let mut assets = Assets::default();
        assets.written.insert(PathBuf::from("Files/a.exr"));
        let plan = Plan::new(PathBuf::from("/shot/a"), &assets, &Environment::empty());
        for (whole, place) in [
            ("/shot/a/b.tx", "b.tx"),
            ("/shot/a", ""),
            ("/shot/b.tx", "files2/shot/b.tx"),
            ("/b.tx", "files2/b.tx"),
            ("/shot/ab/b.tx", "files2/shot/ab/b.tx"),
        ] {
            assert_eq!(slashes(&plan.place(Path::new(whole))), place);
        }
    }
}
