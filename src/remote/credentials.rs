//! Credentials, looked up in the order of Amazon's tools: environment, user's files, container, machine.
//!
//! Without credentials, requests are not signed, which is enough to read a public store. Assumed roles, single sign-on
//! and credential programs are not supported; `aws configure export-credentials --format env` converts them to
//! environment variables.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use rusty_s3::Credentials;
use serde::Deserialize;
use ureq::Agent;

use deaflow_base::read_bounded;

/// Maximum length of a credentials file in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Time before expiry at which credentials are renewed.
const RENEWAL: Duration = Duration::from_secs(300);

/// Pause before another lookup if there are no credentials.
const RETRY: Duration = Duration::from_secs(60);

/// Server of the credentials of a container (Amazon ECS).
const CONTAINER: &str = "http://169.254.170.2";

/// Server of the credentials of a machine (Amazon EC2), unless set in the environment.
const MACHINE: &str = "http://169.254.169.254";

/// Timeout of these servers, which are local.
const TIMEOUT: Duration = Duration::from_secs(1);

/// Credentials of a role, as these servers send them.
#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Role {
    access_key_id: String,
    secret_access_key: String,
    token: Option<String>,
    expiration: Option<String>,
}

struct CachedCredentials {
    credentials: Option<Credentials>,
    expiry: Option<SystemTime>,
}

/// The credentials of this process.
#[derive(Default)]
pub struct CredentialChain {
    cached: Mutex<Option<CachedCredentials>>,
}

/// Returns an environment variable, unless it is unset or blank.
fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.trim().is_empty())
}

impl CredentialChain {
    /// Returns the credentials for the next request, or `None` if there are none.
    pub fn current(&self, agent: &Agent) -> Option<Credentials> {
        let mut cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner);
        let expires_by =
            |time: SystemTime| move |cached: &CachedCredentials| cached.expiry.is_some_and(|expiry| time >= expiry);
        let now = SystemTime::now();
        if cached.as_ref().is_none_or(expires_by(now + RENEWAL)) {
            let found = find(agent);
            let is_usable = |cached: &CachedCredentials| cached.credentials.is_some() && !expires_by(now)(cached);
            if found.credentials.is_some() || !cached.as_ref().is_some_and(is_usable) {
                *cached = Some(found);
            }
        }
        cached.as_ref().and_then(|cached| cached.credentials.clone())
    }
}

fn find(agent: &Agent) -> CachedCredentials {
    match of_environment(&variable).or_else(of_file) {
        None => of_role(agent),
        credentials => CachedCredentials {
            credentials,
            expiry: None,
        },
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

/// Returns the region set in the environment or in the user's file.
pub fn region() -> Option<String> {
    variable("AWS_REGION")
        .or_else(|| variable("AWS_DEFAULT_REGION"))
        .or_else(|| section_of("AWS_CONFIG_FILE", "config", &profile_sections())?.remove("region"))
}

/// Returns the server set in the environment.
pub fn endpoint() -> Option<String> {
    variable("AWS_ENDPOINT_URL_S3").or_else(|| variable("AWS_ENDPOINT_URL"))
}

fn profile() -> String {
    variable("AWS_PROFILE").unwrap_or_else(|| "default".to_owned())
}

fn profile_sections() -> [String; 2] {
    [format!("profile {}", profile()), profile()]
}

/// Returns the first of some sections in a file that a variable names, or in `~/.aws`.
fn section_of(variable_of_file: &str, name: &str, sections: &[impl AsRef<str>]) -> Option<BTreeMap<String, String>> {
    let path = variable(variable_of_file)
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(variable("HOME")?).join(".aws").join(name)))?;
    let text = String::from_utf8(read_bounded(&path, MAX_BYTES).ok()?).ok()?;
    let mut all = parse(&text);
    sections.iter().find_map(|section| all.remove(section.as_ref()))
}

/// Parses sections `[name]` with lines `key = value`. Indented lines belong to the key before them and are skipped.
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

/// Asks the container or the machine for the credentials of its role.
fn of_role(agent: &Agent) -> CachedCredentials {
    let text = of_container(agent).or_else(|| of_machine(agent));
    let role: Option<Role> = text.and_then(|text| serde_json::from_str(&text).ok());
    let expiry = match &role {
        Some(role) => role
            .expiration
            .as_ref()
            .and_then(|time| humantime::parse_rfc3339_weak(time).ok()),
        None => Some(SystemTime::now() + RENEWAL + RETRY),
    };
    CachedCredentials {
        credentials: role.map(|role| credentials(role.access_key_id, role.secret_access_key, role.token)),
        expiry,
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

/// Uses version 2 of the metadata service, which requires a token.
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
        .timeout_global(Some(TIMEOUT))
        .proxy(None)
        .build();
    let mut response = agent.run(request).ok()?;
    if response.status() != 200 {
        return None;
    }
    response.body_mut().with_config().limit(MAX_BYTES).read_to_string().ok()
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
    fn the_environment_must_have_both_key_and_secret() {
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
    fn the_credentials_of_a_role_expire() {
        let text = r#"{"Code":"Success","AccessKeyId":"A","SecretAccessKey":"S","Token":"T","Expiration":"2026-11-22T12:00:00Z"}"#;
        let role: Role = serde_json::from_str(text).unwrap();
        assert_eq!((role.access_key_id.as_str(), role.token.as_deref()), ("A", Some("T")));
        assert!(humantime::parse_rfc3339_weak(&role.expiration.unwrap()).is_ok());
    }
}
