//! Remotes, against an S3-compatible server (moto) if it is installed, and error messages without one.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use deaflow::remote::{Address, Bucket, RemoteError, S3, UploadNote};

use super::common::{Ended, Stages, Transcript, Workspace, files, readers, snapshot};

/// Anybody may do anything in the bucket.
const OPEN: &str = r#"{"Version": "2012-10-17", "Statement": [
    {"Effect": "Allow", "Principal": "*", "Action": "s3:*", "Resource": ["arn:aws:s3:::lab", "arn:aws:s3:::lab/*"]}]}"#;

/// A server of its own for each test.
struct Server {
    process: Child,
    port: u16,
}

impl Server {
    /// None where there is none.
    fn start() -> Option<Self> {
        let python = readers::find("moto, which stands for S3-compatible storage", || {
            readers::python("moto", "moto.server, boto3")
        })?;
        // It takes a number that is free, and says which.
        let said = tempfile::NamedTempFile::new().unwrap();
        let mut command = Command::new(python);
        command.args(["-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]);
        let process = command
            .stdout(Stdio::null())
            .stderr(said.reopen().unwrap())
            .spawn()
            .unwrap();
        let mut server = Self { process, port: 0 };
        let start = Instant::now();
        while server.port == 0 {
            assert!(start.elapsed() < Duration::from_secs(60), "moto does not answer");
            std::thread::sleep(Duration::from_millis(50));
            let text = std::fs::read_to_string(said.path()).unwrap();
            let port = text
                .split("http://127.0.0.1:")
                .nth(1)
                .and_then(|rest| rest.split_once('\n'));
            server.port = port.map_or(0, |(port, _)| port.trim().parse().unwrap());
        }
        for (path, body) in [("/lab", ""), ("/lab?policy", OPEN)] {
            assert!(server.ask("PUT", path, body.as_bytes()).starts_with("HTTP/1.1 200"));
        }
        Some(server)
    }

    fn endpoint(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// Asks without a signature: whoever may write in a bucket.
    fn ask(&self, method: &str, path: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            self.port,
            body.len()
        );
        stream.write_all(&[head.as_bytes(), body].concat()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// Names of objects that begin so.
    fn names(&self, prefix: &str) -> Vec<String> {
        let answer = self.ask("GET", &format!("/lab?list-type=2&prefix={prefix}"), b"");
        let keys = answer.split("<Key>").skip(1);
        keys.map(|rest| rest.split("</Key>").next().unwrap().to_owned())
            .collect()
    }

    fn stop(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The command as somebody with a configuration of their own gives it.
fn command(workspace: &Workspace, who: &str, arguments: &[&str]) -> Command {
    let mut command = workspace.command(arguments);
    command
        .env("DEAFLOW_CONFIG", workspace.path(who))
        .env("AWS_ACCESS_KEY_ID", "testing")
        .env("AWS_SECRET_ACCESS_KEY", "testing");
    for other in [
        "AWS_ENDPOINT_URL",
        "AWS_ENDPOINT_URL_S3",
        "AWS_SESSION_TOKEN",
        "AWS_REGION",
        "DEAFLOW_REMOTE",
    ] {
        command.env_remove(other);
    }
    command
}

fn run(workspace: &Workspace, who: &str, arguments: &[&str]) -> Ended {
    Ended::from(command(workspace, who, arguments).output().unwrap())
}

/// What a command says as JSON; it must end so.
fn document(workspace: &Workspace, who: &str, arguments: &[&str], code: i32) -> serde_json::Value {
    let ended = run(workspace, who, &[arguments, &["--json"]].concat());
    assert_eq!(ended.code, Some(code), "{}\n{}", ended.stdout, ended.stderr);
    ended.json()
}

/// What a command on `small.yaml` says that reads a store through the remote.
fn through(workspace: &Workspace, who: &str, (command, store): (&str, &str), more: &[&str]) -> serde_json::Value {
    let arguments = [command, "small.yaml", "--remote", "lab", "--store", store];
    document(workspace, who, &[&arguments[..], more].concat(), 0)
}

/// Something that changes one stage, for which what it needs has to be read.
const CHANGE: [&str; 2] = ["--set", "stages.balanced.seed=77"];

/// Somebody makes a key.
fn key(workspace: &Workspace, who: &str) {
    let made = run(workspace, who, &["remote", "key"]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    workspace.write(&format!("{who}.pub"), &made.stdout);
}

/// Somebody adds the remote, trusting some others.
fn add(workspace: &Workspace, who: &str, server: &Server, trusted: &[&str]) {
    let added = try_to_add(workspace, who, server, trusted, &[]);
    assert_eq!(added.code, Some(0), "{}", added.stderr);
}

fn try_to_add(workspace: &Workspace, who: &str, server: &Server, trusted: &[&str], more: &[&str]) -> Ended {
    let files: Vec<String> = trusted.iter().map(|name| format!("{name}.pub")).collect();
    let (url, endpoint) = ("s3://lab/a/store", server.endpoint());
    let mut arguments = vec!["remote", "add", "lab", url, "--endpoint", &endpoint];
    arguments.extend(files.iter().flat_map(|file| ["--key", file.as_str()]));
    arguments.extend(more);
    run(workspace, who, &arguments)
}

/// A server, and Anna who has run `small.yaml` in the store `a` and pushed it.
fn pushed() -> Option<(Workspace, Server, Stages)> {
    let server = Server::start()?;
    let workspace = Workspace::small();
    let stages = workspace.stages(&["run", "small.yaml", "--store", "a"]);
    key(&workspace, "anna");
    add(&workspace, "anna", &server, &["anna"]);
    let pushed = document(&workspace, "anna", &["push", "--store", "a"], 0);
    assert!(pushed["objects"].as_u64() > Some(3) && pushed["left"].as_array().unwrap().is_empty());
    Some((workspace, server, stages))
}

fn stages_of(document: &serde_json::Value) -> Stages {
    Stages::read(document)
}

#[test]
fn other_machines_reuse_what_one_has_built() {
    let Some((workspace, server, built)) = pushed() else {
        return;
    };
    let again = document(&workspace, "anna", &["push", "small.yaml", "--store", "a"], 0);
    assert_eq!((&again["objects"], &again["records"]), (&0.into(), &0.into()));
    add(&workspace, "ben", &server, &["anna"]);

    // Records alone: a run that builds nothing needs nothing.
    let pulled = document(&workspace, "ben", &["pull", "--records-only", "--store", "b"], 0);
    assert!(pulled["records"].as_u64() > Some(3));
    assert!(files(&workspace.path("b/objects")).is_empty());
    let ran = through(&workspace, "ben", ("run", "b"), &[]);
    assert_eq!(stages_of(&ran).digests(), built.digests());
    assert_eq!(stages_of(&ran).with("reused"), built.names());
    assert_eq!(
        (&ran["remote"]["artifacts"], ran["elsewhere"].as_array().unwrap().len()),
        (&0.into(), 4)
    );
    assert!(files(&workspace.path("b/objects")).is_empty());
    // What is on the remote only is fetched next: it is in no report, and nothing can show it.
    let ran = run(
        &workspace,
        "ben",
        &["run", "small.yaml", "--remote", "lab", "--store", "b"],
    );
    let next = "next: deaflow pull small.yaml --store b --remote lab";
    assert!(ran.code == Some(0) && ran.stdout.contains(next), "{ran}");
    for (arguments, told) in [
        (
            &["report", "small.yaml", "-o", "out", "--store", "b"][..],
            "deaflow pull small.yaml --store b --remote lab",
        ),
        (
            &["show", "solved", "--store", "b"],
            "deaflow pull PIPELINE.yaml --remote lab",
        ),
    ] {
        let ended = run(&workspace, "ben", arguments);
        assert!(ended.code != Some(0) && ended.stderr.contains(told), "{ended}");
    }
    let plan = through(&workspace, "ben", ("plan", "b"), &[]);
    assert_eq!(stages_of(&plan).with("reused").len(), 4);

    // What changes is built from what is brought for it, and no more.
    let ran = through(&workspace, "ben", ("run", "b"), &CHANGE);
    assert_eq!(stages_of(&ran).with("built"), ["balanced"]);
    assert!(ran["remote"]["artifacts"].as_u64() > Some(1));
    assert_eq!(ran["elsewhere"], serde_json::json!(["small", "large"]));
    let alone = workspace.stages(&[&["run", "small.yaml", "--store", "a"][..], &CHANGE].concat());
    assert_eq!(stages_of(&ran).digests(), alone.digests());

    // All of one pipeline; after it nothing is asked for.
    let pulled = document(&workspace, "ben", &["pull", "small.yaml", "--store", "b"], 0);
    assert_eq!(
        (&pulled["left"], &pulled["not_built"]),
        (&serde_json::json!([]), &serde_json::json!([]))
    );
    // Chunks count in all numbers.
    let again = document(&workspace, "ben", &["pull", "small.yaml", "--store", "b"], 0);
    let [fetched, here] = ["artifacts", "artifacts_here"].map(|key| pulled[key].as_u64().unwrap());
    assert_eq!(
        (&again["artifacts"], &again["artifacts_here"]),
        (&0.into(), &(fetched + here).into())
    );
    assert!(fetched + here > 4, "{pulled}");
    let ran = workspace.stages(&["run", "small.yaml", "--store", "b"]);
    assert_eq!((ran.with("reused").len(), ran.digests()), (4, built.digests()));
    let checked = run(&workspace, "ben", &["fsck", "--store", "b"]);
    assert_eq!(checked.code, Some(0), "{}", checked.stdout);

    // A worker reads through it too.
    let worked = through(&workspace, "ben", ("worker", "w"), &[]);
    assert_eq!(stages_of(&worked).with("reused").len(), 4);
}

#[test]
fn write_access_to_the_bucket_is_not_enough_to_change_results() {
    let Some((workspace, server, built)) = pushed() else {
        return;
    };
    // Eve has a key of her own and other numbers under the same actions.
    key(&workspace, "eve");
    add(&workspace, "eve", &server, &["anna"]);
    add(&workspace, "ben", &server, &["anna"]);
    workspace.stages(&["run", "small.yaml", "--store", "e", "--until", "small"]);
    document(&workspace, "eve", &["push", "--store", "e"], 0);
    // She exchanges an object, and damages a file of records.
    let digest = &built.digests()["solved"];
    let name = format!("/lab/a/store/objects/{}/{digest}.h5", &digest[..2]);
    let other = built.digests()["small"].clone();
    let bytes = files(&workspace.path("a/objects"));
    let bytes = bytes
        .iter()
        .find(|path| path.to_str().unwrap().contains(&other))
        .unwrap();
    for (name, bytes) in [
        (name.as_str(), std::fs::read(bytes).unwrap()),
        ("/lab/a/store/records/readme", b"hello".to_vec()),
    ] {
        assert!(server.ask("PUT", name, &bytes).starts_with("HTTP/1.1 200"));
    }

    // Who trusts neither gets nothing, and is told why.
    key(&workspace, "dora");
    add(&workspace, "dora", &server, &["dora"]);
    let pulled = run(&workspace, "dora", &["pull", "small.yaml", "--store", "x"]);
    assert_eq!(pulled.code, Some(1), "{pulled}");
    assert!(
        pulled.stderr.contains("records of untrusted keys are ignored"),
        "{pulled}"
    );

    let pulled = run(&workspace, "ben", &["pull", "--store", "b"]);
    assert_eq!(pulled.code, Some(1), "{}", pulled.stderr);
    let text = pulled.stderr.clone() + &pulled.stdout;
    for part in ["readme", &digest[..12]] {
        assert!(text.contains(part), "{part}: {pulled}");
    }
    snapshot!(pulled);
    let checked = run(&workspace, "ben", &["fsck", "--store", "b"]);
    assert_eq!(checked.code, Some(0), "{}", checked.stdout);
    // What was found wrong is built by the next command, and so is what is looked into.
    let ran = through(&workspace, "ben", ("run", "b"), &[]);
    assert_eq!(stages_of(&ran).with("built"), ["solved"]);
    assert_eq!(stages_of(&ran).digests(), built.digests());
    let ran = through(&workspace, "ben", ("run", "v"), &["--verify"]);
    assert_eq!(stages_of(&ran).with("built"), ["solved"]);
    assert_eq!(ran["elsewhere"], serde_json::json!([]));
    // What cannot be had is built.
    let ran = through(&workspace, "ben", ("run", "c"), &[]);
    assert_eq!(stages_of(&ran).digests(), built.digests());
    let ran = through(&workspace, "ben", ("run", "c"), &CHANGE);
    assert_eq!(stages_of(&ran).with("built"), ["solved", "balanced"]);
    assert_eq!(&stages_of(&ran).digests()["solved"], digest);
    // Sent again, it is mended.
    document(&workspace, "anna", &["push", "--again", "--store", "a"], 0);
    let pulled = document(&workspace, "ben", &["pull", "--store", "b"], 0);
    assert_eq!(pulled["left"], serde_json::json!([]));
    // Ben trusts Eve as well now: both say the same.
    let refused = try_to_add(&workspace, "ben", &server, &["anna", "eve"], &[]);
    assert_eq!(refused.code, Some(2), "{}", refused.stdout);
    assert!(refused.stderr.contains("with other trusted keys"), "{}", refused.stderr);
    let replaced = try_to_add(&workspace, "ben", &server, &["anna", "eve"], &["--replace"]);
    assert_eq!(replaced.code, Some(0), "{}", replaced.stderr);
    let pulled = document(&workspace, "ben", &["pull", "--store", "d"], 0);
    assert_eq!(pulled["passed_over"]["untrusted"], serde_json::json!([]));
    assert_eq!(pulled["passed_over"]["disagreements"], serde_json::json!([]));
    // An object that is gone is not counted on, and a pull is incomplete without it.
    assert!(server.ask("DELETE", &name, b"").starts_with("HTTP/1.1 204"));
    let pulled = document(&workspace, "ben", &["pull", "small.yaml", "--store", "p"], 1);
    assert_eq!(
        (&pulled["left"], &pulled["not_built"]),
        (&serde_json::json!([digest]), &serde_json::json!([]))
    );
    document(
        &workspace,
        "ben",
        &["pull", "small.yaml", "--store", "p", "--until", "large"],
        0,
    );
    let ran = through(&workspace, "ben", ("run", "f"), &[]);
    assert_eq!(stages_of(&ran).with("built"), ["solved"]);
    assert_eq!(stages_of(&ran).digests(), built.digests());
    // Records of Anna that are not hers are an error.
    let anna = std::fs::read_to_string(workspace.path("anna.pub")).unwrap();
    let own = server.names("a/store/records/");
    let own = own.iter().find(|name| anna.contains(name.split('/').nth(3).unwrap()));
    server.ask("PUT", &format!("/lab/{}", own.unwrap()), b"others");
    let pulled = document(&workspace, "ben", &["pull", "--records-only", "--store", "g"], 1);
    assert!(
        pulled["passed_over"]["rejected"].as_array().unwrap().len() > 1,
        "{pulled}"
    );
}

#[test]
fn records_read_before_are_used_without_the_network() {
    let Some((workspace, mut server, built)) = pushed() else {
        return;
    };
    add(&workspace, "ben", &server, &["anna"]);
    document(&workspace, "ben", &["pull", "--records-only", "--store", "b"], 0);
    server.stop();
    let ran = run(
        &workspace,
        "ben",
        &["run", "small.yaml", "--remote", "lab", "--store", "b", "--json"],
    );
    // Whether the results are there is not known.
    assert_eq!(ran.code, Some(75), "{}", ran.stderr);
    assert_eq!(stages_of(&ran.json()).digests(), built.digests());
    assert!(
        ran.stderr.contains("warning: ") && ran.stderr.contains("not here"),
        "{}",
        ran.stderr
    );
    // What has to be read is built.
    let ran = through(&workspace, "ben", ("run", "b"), &CHANGE);
    assert!(stages_of(&ran).with("built").contains(&"balanced"));
    for arguments in [&["push", "--store", "a"], &["pull", "--store", "c"]] {
        let ended = run(&workspace, "anna", arguments);
        assert_eq!(ended.code, Some(75), "{}", ended.stderr);
        assert!(ended.stderr.contains("127.0.0.1"), "{}", ended.stderr);
        assert!(!ended.stderr.contains("Signature"), "{}", ended.stderr);
    }
}

#[test]
fn a_collection_keeps_recorded_objects() {
    let Some((workspace, server, _)) = pushed() else { return };
    server.ask("PUT", "/lab/a/store/objects/00/notes.txt", b"mine");
    let before = server.names("a/store/objects/").len();
    let swept = document(
        &workspace,
        "anna",
        &["remote", "gc", "lab", "--grace", "0s", "--store", "a"],
        0,
    );
    assert_eq!((&swept["objects_removed"], &swept["not_ours"]), (&0.into(), &1.into()));
    std::thread::sleep(Duration::from_millis(1100));
    let all = ["remote", "gc", "lab", "--grace", "0s", "--older", "0s", "--store", "a"];
    let tried = document(&workspace, "anna", &[&all[..], &["--dry-run"]].concat(), 0);
    assert_eq!(server.names("a/store/objects/").len(), before);
    let swept = document(&workspace, "anna", &all, 0);
    assert_eq!(swept["objects_removed"], tried["objects_removed"]);
    assert_eq!(server.names("a/store/objects/"), ["a/store/objects/00/notes.txt"]);
    assert!(server.names("a/store/records/").is_empty());
}

#[test]
fn a_large_file_is_sent_in_pieces_and_goes_on_where_it_stopped() {
    let Some(server) = Server::start() else { return };
    let workspace = Workspace::new();
    // Without credentials nothing is signed, and moto asks for none.
    let address = Address::parse("s3://lab/big", Some(&server.endpoint()), Some("us-east-1")).unwrap();
    let s3 = S3::open(&address).unwrap();
    let size: u64 = 70 << 20;
    let whole: Vec<u8> = (0..size).map(|i| (i / 4093 % 251) as u8).collect();
    let path = workspace.path("large");
    let path_of_note = workspace.path("note");
    let note = UploadNote {
        path: &path_of_note,
        content: "these bytes".to_owned(),
    };
    // The file is cut off after the second piece of three.
    std::fs::write(&path, &whole[..65 << 20]).unwrap();
    assert!(s3.put_file("large", &path, size, &note).is_err());
    assert!(path_of_note.exists() && s3.list("").unwrap().is_empty());
    // Of other bytes nothing is gone on with; of the same it is.
    std::fs::write(&path, &whole).unwrap();
    s3.put_file("large", &path, size, &note).unwrap();
    assert!(!path_of_note.exists());
    let target = workspace.path("back");
    assert_eq!(s3.get_file("large", &target, size).unwrap(), Some(size));
    assert!(std::fs::read(&target).unwrap() == whole);
    assert!(s3.get_file("large", &target, size - 1).is_err());
    assert_eq!(s3.list("").unwrap()[0].size, size);
    assert_eq!(s3.get_file("none", &target, size).unwrap(), None);
    let refused = S3::open(&Address::parse("s3://nobucket", Some(&server.endpoint()), None).unwrap()).unwrap();
    for error in [
        refused.put("x", b"x").unwrap_err(),
        refused.list("").map(|_| ()).unwrap_err(),
    ] {
        assert!(
            matches!(&error, RemoteError::Refused { code, .. } if code == "NoSuchBucket"),
            "{error}"
        );
    }
}

#[test]
fn mistakes_with_remotes_and_keys_are_refused() {
    let workspace = Workspace::tiny();
    key(&workspace, "anna");
    let again = run(&workspace, "anna", &["remote", "key"]);
    assert_eq!(
        again.stdout,
        std::fs::read_to_string(workspace.path("anna.pub")).unwrap()
    );
    let listed = run(&workspace, "anna", &["remote", "list"]);
    assert_eq!(listed.code, Some(0), "{listed}");
    let mut printed = Transcript::default();
    printed.add("remote list", listed);
    workspace.write("empty.pub", "");
    let secret = workspace.path("anna/signing.key").display().to_string();
    for (arguments, named) in [
        (&["push"][..], "store"),
        (&["pull"], "remote"),
        (&["run", "tiny.yaml", "--remote", "lab"], "`lab`"),
        (&["remote", "remove", "lab"], "`lab`"),
        (&["remote", "add", "lab", "lab", "--key", "anna.pub"], "lab"),
        (&["remote", "add", "lab", "s3://lab", "--key", "empty.pub"], "empty.pub"),
        (&["remote", "add", "lab", "s3://lab", "--key", "none.pub"], "none.pub"),
        (&["remote", "add", "lab", "s3://lab", "--key", &secret], "signing.key"),
        (&["remote", "add", "a/b", "s3://lab", "--key", "anna.pub"], "a/b"),
    ] {
        let ended = run(&workspace, "anna", arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(named), "{arguments:?}: {}", ended.stderr);
        printed.add(arguments.join(" "), ended);
    }
    snapshot!(printed);
    let mode = std::os::unix::fs::PermissionsExt::mode(&std::fs::metadata(Path::new(&secret)).unwrap().permissions());
    assert_eq!(mode & 0o777, 0o600);
}
