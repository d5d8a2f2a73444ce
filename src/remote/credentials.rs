//! Where credentials come from, in the order of Amazon's tools: the environment, the user's file, the container, the machine.
//!
//! Without any, requests are not signed: a public store can be read so. Roles that have to be assumed, single sign-on and
//! programs that give credentials are not known; `aws configure export-credentials --format env` turns them into an environment.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use rusty_s3::Credentials;
use serde::Deserialize;
use ureq::Agent;

use deaflow_base::read_bounded;

/// Files of credentials are shorter, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Before they expire new ones are asked for.
const EARLY: Duration = Duration::from_secs(300);

/// Where there were none, they are looked for again after this.
const AGAIN: Duration = Duration::from_secs(60);

/// Where a container asks for its role (Amazon ECS).
const CONTAINER: &str = "http://169.254.170.2";

/// Where a machine asks for its role (Amazon EC2), unless the environment says otherwise.
const MACHINE: &str = "http://169.254.169.254";

/// A machine that has a role answers at once.
const SOON: Duration = Duration::from_secs(1);

/// Credentials as a role has them.
#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Role {
    access_key_id: String,
    secret_access_key: String,
    token: Option<String>,
    expiration: Option<String>,
}

#[derive(Clone)]
struct Held {
    credentials: Option<Credentials>,
    until: Option<SystemTime>,
}

/// The credentials of this process.
#[derive(Default)]
pub struct Chain {
    held: Mutex<Option<Held>>,
}

/// The environment, for one variable that is set to something.
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.trim().is_empty())
}

impl Chain {
    /// The credentials to sign the next request with; none where there are none.
    pub fn now(&self, agent: &Agent) -> Option<Credentials> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let is_over = |held: &Held| held.until.is_some_and(|until| SystemTime::now() >= until);
        let is_late = |held: &Held| held.until.is_some_and(|until| SystemTime::now() + EARLY >= until);
        if held.as_ref().is_none_or(is_late) {
            let found = find(agent);
            // What cannot be renewed just now serves to its end.
            let serves = held
                .as_ref()
                .is_some_and(|held| held.credentials.is_some() && !is_over(held));
            if found.credentials.is_some() || !serves {
                *held = Some(found);
            }
        }
        held.as_ref().and_then(|held| held.credentials.clone())
    }
}

fn find(agent: &Agent) -> Held {
    let lasting = of_environment(&|name| variable(name)).or_else(of_file);
    match lasting {
        Some(credentials) => Held {
            credentials: Some(credentials),
            until: None,
        },
        None => of_role(agent),
    }
}

fn of_environment(variable: &dyn Fn(&str) -> Option<String>) -> Option<Credentials> {
    let key = variable("AWS_ACCESS_KEY_ID")?;
    let secret = variable("AWS_SECRET_ACCESS_KEY")?;
    Some(credentials(key, secret, variable("AWS_SESSION_TOKEN")))
}

fn credentials(key: String, secret: String, token: Option<String>) -> Credentials {
    match token {
        Some(token) => Credentials::new_with_token(key, secret, token),
        None => Credentials::new(key, secret),
    }
}

fn of_file() -> Option<Credentials> {
    let section = section_of("AWS_SHARED_CREDENTIALS_FILE", "credentials", &[&profile()])
        .or_else(|| section_of("AWS_CONFIG_FILE", "config", &profile_sections()))?;
    let value = |name: &str| section.get(name).cloned();
    Some(credentials(
        value("aws_access_key_id")?,
        value("aws_secret_access_key")?,
        value("aws_session_token"),
    ))
}

/// The region that the user's file gives.
fn region_of_file() -> Option<String> {
    section_of("AWS_CONFIG_FILE", "config", &profile_sections())?.remove("region")
}

/// The region that the environment gives, or the user's file.
pub fn region() -> Option<String> {
    variable("AWS_REGION")
        .or_else(|| variable("AWS_DEFAULT_REGION"))
        .or_else(region_of_file)
}

/// The server that the environment gives.
pub fn endpoint() -> Option<String> {
    variable("AWS_ENDPOINT_URL_S3").or_else(|| variable("AWS_ENDPOINT_URL"))
}

fn profile() -> String {
    variable("AWS_PROFILE").unwrap_or_else(|| "default".to_owned())
}

fn profile_sections() -> [String; 2] {
    [format!("profile {}", profile()), profile()]
}

fn section_of(variable_of_file: &str, name: &str, sections: &[impl AsRef<str>]) -> Option<BTreeMap<String, String>> {
    let path = variable(variable_of_file)
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(variable("HOME")?).join(".aws").join(name)))?;
    let text = String::from_utf8(read_bounded(&path, MAX_BYTES).ok()?).ok()?;
    let mut all = parse(&text);
    sections.iter().find_map(|section| all.remove(section.as_ref()))
}

/// Sections of `[name]` and lines of `key = value`. Indented lines belong to the key before them, and to nobody here.
fn parse(text: &str) -> BTreeMap<String, BTreeMap<String, String>> {
    let mut sections: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    let mut current = None;
    for line in text.lines().filter(|line| !line.starts_with([' ', '\t', '#', ';'])) {
        if let Some(name) = line.trim().strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            let name = name.trim().to_owned();
            sections.entry(name.clone()).or_default();
            current = Some(name);
        } else if let (Some(name), Some((key, value))) = (&current, line.split_once('=')) {
            let section = sections.entry(name.clone()).or_default();
            section.insert(key.trim().to_owned(), value.trim().to_owned());
        }
    }
    sections
}

/// That of the container or of the machine.
fn of_role(agent: &Agent) -> Held {
    let text = of_container(agent).or_else(|| of_machine(agent));
    let role: Option<Role> = text.and_then(|text| serde_json::from_str(&text).ok());
    let until = role
        .as_ref()
        .and_then(|role| humantime::parse_rfc3339_weak(role.expiration.as_ref()?).ok());
    Held {
        // Where there is none, somebody may be asked again before long.
        until: until.or_else(|| role.is_none().then(|| SystemTime::now() + EARLY + AGAIN)),
        credentials: role.map(|role| credentials(role.access_key_id, role.secret_access_key, role.token)),
    }
}

fn of_container(agent: &Agent) -> Option<String> {
    let url = variable("AWS_CONTAINER_CREDENTIALS_FULL_URI")
        .or_else(|| Some(CONTAINER.to_owned() + &variable("AWS_CONTAINER_CREDENTIALS_RELATIVE_URI")?))?;
    let token = variable("AWS_CONTAINER_AUTHORIZATION_TOKEN").or_else(|| {
        let path = variable("AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE")?;
        let bytes = read_bounded(&PathBuf::from(path), MAX_BYTES).ok()?;
        Some(String::from_utf8(bytes).ok()?.trim().to_owned())
    });
    let headers: Vec<(&str, &str)> = token.iter().map(|token| ("authorization", token.as_str())).collect();
    ask(agent, "GET", &url, &headers)
}

/// By the second version of the service, which asks for a token first.
fn of_machine(agent: &Agent) -> Option<String> {
    if variable("AWS_EC2_METADATA_DISABLED").is_some_and(|value| value.eq_ignore_ascii_case("true")) {
        return None;
    }
    let server = variable("AWS_EC2_METADATA_SERVICE_ENDPOINT").unwrap_or_else(|| MACHINE.to_owned());
    let server = server.trim_end_matches('/');
    let token = ask(
        agent,
        "PUT",
        &format!("{server}/latest/api/token"),
        &[("x-aws-ec2-metadata-token-ttl-seconds", "21600")],
    )?;
    let headers = [("x-aws-ec2-metadata-token", token.trim())];
    let roles = format!("{server}/latest/meta-data/iam/security-credentials/");
    let names = ask(agent, "GET", &roles, &headers)?;
    let role = names.lines().next()?.trim().to_owned();
    ask(agent, "GET", &format!("{roles}{role}"), &headers)
}

fn ask(agent: &Agent, method: &str, url: &str, headers: &[(&str, &str)]) -> Option<String> {
    let mut request = ureq::http::Request::builder().method(method).uri(url);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let request = agent
        .configure_request(request.body(()).ok()?)
        .timeout_global(Some(SOON))
        .proxy(None)
        .build();
    let mut answer = agent.run(request).ok()?;
    if answer.status() != 200 {
        return None;
    }
    answer.body_mut().with_config().limit(MAX_BYTES).read_to_string().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_credentials_is_read_by_sections() {
        let text = "# mine\n[default]\naws_access_key_id=A\naws_secret_access_key = S=1\n[profile lab]\nregion = eu-west-1\ns3 =\n  max = 3\n";
        let sections = parse(text);
        assert_eq!(sections["default"]["aws_secret_access_key"], "S=1");
        assert_eq!(sections["profile lab"]["region"], "eu-west-1");
        assert!(!sections["profile lab"].contains_key("max"));
        assert!(parse("key = value\n[").is_empty());
    }

    #[test]
    fn the_environment_gives_a_key_with_its_secret_or_nothing() {
        let of = |given: &[(&str, &str)]| {
            let given: BTreeMap<String, String> =
                given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
            of_environment(&move |name| given.get(name).cloned())
        };
        assert!(of(&[("AWS_ACCESS_KEY_ID", "A")]).is_none());
        let both = [
            ("AWS_ACCESS_KEY_ID", "A"),
            ("AWS_SECRET_ACCESS_KEY", "S"),
            ("AWS_SESSION_TOKEN", "T"),
        ];
        let found = of(&both).unwrap();
        assert_eq!((found.key(), found.secret(), found.token()), ("A", "S", Some("T")));
    }

    #[test]
    fn a_role_says_until_when() {
        let text = r#"{"Code":"Success","AccessKeyId":"A","SecretAccessKey":"S","Token":"T","Expiration":"2026-11-22T12:00:00Z"}"#;
        let role: Role = serde_json::from_str(text).unwrap();
        assert_eq!((role.access_key_id.as_str(), role.token.as_deref()), ("A", Some("T")));
        assert!(humantime::parse_rfc3339_weak(&role.expiration.unwrap()).is_ok());
    }
}
