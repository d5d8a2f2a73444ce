//! The user's configuration of remotes: `remotes/NAME.yaml` and `remotes/NAME.pub` in the configuration folder, and the
//! private key `signing.key`. Pipelines cannot add trusted keys.

use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::RemoteError;
use super::key::{TrustedKey, read_public_keys};
use deaflow_base::{Digest, Document, InputError, Map, is_plain_name, write_output};

/// The location of a remote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name of the bucket.
    pub bucket: String,
    /// Prefix of all object names, without `/` at its ends; may be empty.
    pub prefix: String,
    /// URL of the server, if it is neither Amazon's nor set in the environment.
    pub endpoint: Option<String>,
    /// Region, if it is not set in the environment.
    pub region: Option<String>,
}

/// The user's configuration.
#[derive(Clone, Debug)]
pub struct Configuration {
    folder: PathBuf,
}

/// The configuration of one remote.
#[derive(Clone, Debug)]
pub struct RemoteConfiguration {
    /// Name of the remote.
    pub name: String,
    /// Location of the remote.
    pub address: Address,
    /// Keys whose records are used.
    pub trusted: Vec<TrustedKey>,
}

/// Maximum length of the name of a remote.
const MAX_NAME: usize = 64;

impl Address {
    /// Parses `s3://BUCKET/PREFIX`.
    ///
    /// # Errors
    /// Returns an error if the URL or the endpoint is invalid.
    pub fn parse(url: &str, endpoint: Option<&str>, region: Option<&str>) -> Result<Self, InputError> {
        let wrong = |what: String| {
            InputError::new(what).help("allowed: s3://BUCKET or s3://BUCKET/PREFIX of letters, digits, `-`, `_`, `.`")
        };
        let rest = url
            .strip_prefix("s3://")
            .ok_or_else(|| wrong(format!("{url:?} is not the URL of a remote")))?;
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let prefix = prefix.trim_end_matches('/');
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        let is_segment = |part: &str| !part.is_empty() && part.chars().all(plain) && ![".", ".."].contains(&part);
        if !is_segment(bucket) || bucket.len() > 255 {
            return Err(wrong(format!("{url:?} has no valid bucket name")));
        }
        if !prefix.is_empty() && !prefix.split('/').all(is_segment) || prefix.len() > 512 {
            return Err(wrong(format!("the prefix of {url:?} is not allowed")));
        }
        if let Some(endpoint) = endpoint {
            check_endpoint(endpoint)?;
        }
        if let Some(region) = region.filter(|region| !is_segment(region)) {
            return Err(InputError::new(format!("{region:?} is not a region")).help("example: eu-west-1"));
        }
        Ok(Self {
            bucket: bucket.to_owned(),
            prefix: prefix.to_owned(),
            endpoint: endpoint.map(|endpoint| endpoint.trim_end_matches('/').to_owned()),
            region: region.map(str::to_owned),
        })
    }

    /// Returns the URL.
    #[must_use]
    pub fn url(&self) -> String {
        match self.prefix.as_str() {
            "" => format!("s3://{}", self.bucket),
            prefix => format!("s3://{}/{prefix}", self.bucket),
        }
    }

    /// Returns a digest of the location, which names the folder for cached records.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let endpoint = self.endpoint.as_deref().unwrap_or_default();
        Digest::of(format!("{}\n{endpoint}", self.url()).as_bytes())
    }
}

/// Checks the URL of a server. Text before an `@` may be a password, so the error does not repeat it.
///
/// # Errors
/// Returns an error if the URL is invalid.
pub fn check_endpoint(endpoint: &str) -> Result<(), InputError> {
    let help = "example: https://minio.lab.org:9000";
    if endpoint.contains('@') {
        return Err(InputError::new("the URL of a server must not contain a user name or password").help(help));
    }
    let rest = endpoint
        .strip_prefix("https://")
        .or_else(|| endpoint.strip_prefix("http://"));
    let plain = |c: char| c.is_ascii_alphanumeric() || "-._:[]/".contains(c);
    let is_host = |host: &str| !host.is_empty() && host.chars().all(plain);
    let parsed = endpoint.parse::<ureq::http::Uri>().ok();
    let has_host = parsed.is_some_and(|uri| uri.host().is_some_and(|host| !host.is_empty()));
    match rest {
        Some(host) if is_host(host) && has_host => Ok(()),
        _ => Err(InputError::new(format!("{endpoint:?} is not the URL of a server")).help(help)),
    }
}

impl Configuration {
    /// Returns the user's configuration: `$DEAFLOW_CONFIG`, or `deaflow` in `$XDG_CONFIG_HOME` or `~/.config`.
    ///
    /// # Errors
    /// Returns an error if the environment defines none of these folders.
    pub fn of_user() -> Result<Self, InputError> {
        let set = |name: &str| {
            std::env::var_os(name)
                .filter(|value| !value.is_empty())
                .map(PathBuf::from)
        };
        let folder = set("DEAFLOW_CONFIG")
            .or_else(|| Some(set("XDG_CONFIG_HOME")?.join("deaflow")))
            .or_else(|| Some(set("HOME")?.join(".config/deaflow")));
        let folder = folder.ok_or_else(|| {
            InputError::new("cannot find the configuration folder").help("set DEAFLOW_CONFIG or HOME to a folder")
        })?;
        Ok(Self { folder })
    }

    /// Returns the configuration in a folder.
    #[must_use]
    pub fn in_folder(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
        }
    }

    /// Returns the path of the private key.
    #[must_use]
    pub fn signing_key(&self) -> PathBuf {
        self.folder.join("signing.key")
    }

    /// Creates the folder.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be created.
    pub fn create_folder(&self) -> Result<(), RemoteError> {
        let folder = self.remotes();
        fs::create_dir_all(&folder).map_err(RemoteError::io("create", &folder))
    }

    fn remotes(&self) -> PathBuf {
        self.folder.join("remotes")
    }

    /// Returns the path of the file with the location of a remote.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.remotes().join(format!("{name}.yaml"))
    }

    /// Returns the path of the file with the trusted keys of a remote.
    #[must_use]
    pub fn keys(&self, name: &str) -> PathBuf {
        self.remotes().join(format!("{name}.pub"))
    }

    /// Adds a remote, or replaces the one of that name if `replace`.
    ///
    /// # Errors
    /// Returns an error if the name is invalid, a remote of that name has another address or other trusted keys and is
    /// not to be replaced, or a file cannot be written.
    pub fn add(&self, name: &str, address: &Address, trusted: &[TrustedKey], replace: bool) -> Result<(), RemoteError> {
        check_name(name)?;
        if !replace && let Some(there) = self.find(name)? {
            let keys = |all: &[TrustedKey]| all.iter().map(|one| one.key).collect::<BTreeSet<_>>();
            let differs = match there.address != *address {
                true => Some(format!("at {}", there.address.url())),
                false if keys(&there.trusted) != keys(trusted) => Some("with other trusted keys".to_owned()),
                false => None,
            };
            if let Some(differs) = differs {
                return Err(InputError::new(format!("remote `{name}` exists already, {differs}"))
                    .help("replace it with --replace, or choose another name")
                    .into());
            }
        }
        self.create_folder()?;
        let mut text = format!("version: 1\nurl: \"{}\"\n", address.url());
        for (key, value) in [("endpoint", &address.endpoint), ("region", &address.region)] {
            if let Some(value) = value {
                text += &format!("{key}: \"{value}\"\n");
            }
        }
        let lines: String = trusted.iter().map(|trusted| trusted.key.line(&trusted.owner)).collect();
        let keys = format!("# trusted keys of {name}, one per line: ed25519 DIGITS NAME\n{lines}");
        let refused = |error| RemoteError::Store(deaflow_store::StoreError::Output(error));
        write_output(&self.keys(name), keys.as_bytes()).map_err(refused)?;
        write_output(&self.file(name), text.as_bytes()).map_err(refused)
    }

    /// Removes a remote from the configuration and returns whether it existed.
    ///
    /// # Errors
    /// Returns an error if the name is invalid or a file cannot be removed.
    pub fn remove(&self, name: &str) -> Result<bool, RemoteError> {
        check_name(name)?;
        let mut removed = false;
        for path in [self.file(name), self.keys(name)] {
            match fs::remove_file(&path) {
                Ok(()) => removed = true,
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(RemoteError::io("remove", &path)(error)),
            }
        }
        Ok(removed)
    }

    /// Returns the sorted names of all remotes.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be read.
    pub fn names(&self) -> Result<Vec<String>, RemoteError> {
        let folder = self.remotes();
        let entries = match fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(RemoteError::io("read", &folder)(error)),
        };
        let mut names = Vec::new();
        for entry in entries {
            let name = entry.map_err(RemoteError::io("read", &folder))?.file_name();
            let name = name.to_str().and_then(|name| name.strip_suffix(".yaml"));
            names.extend(name.filter(|name| check_name(name).is_ok()).map(str::to_owned));
        }
        names.sort_unstable();
        Ok(names)
    }

    /// Returns the configuration of a remote, or `None` if there is no remote of that name.
    ///
    /// # Errors
    /// Returns an error if its files cannot be read.
    pub fn find(&self, name: &str) -> Result<Option<RemoteConfiguration>, RemoteError> {
        check_name(name)?;
        let path = self.file(name);
        if !path.exists() {
            return Ok(None);
        }
        const WHAT: &str = "the remote";
        let document = Document::load(&path)?;
        let map = document.root.fields(WHAT, &["version", "url", "endpoint", "region"])?;
        map.required(WHAT, "version")?.integer("version", 1, 1)?;
        let url = map.required(WHAT, "url")?.text("url")?;
        let address = Address::parse(url, text_of(&map, "endpoint")?, text_of(&map, "region")?)
            .map_err(|error| map.error(error.to_string()))?;
        Ok(Some(RemoteConfiguration {
            name: name.to_owned(),
            address,
            trusted: read_public_keys(&self.keys(name))?,
        }))
    }
}

fn text_of<'a>(map: &Map<'a>, key: &str) -> Result<Option<&'a str>, InputError> {
    map.optional(key).map(|node| node.text(key)).transpose()
}

fn check_name(name: &str) -> Result<(), InputError> {
    match is_plain_name(name, MAX_NAME) {
        true => Ok(()),
        false => {
            let message = format!("{name:?} is not a valid name of a remote");
            Err(InputError::new(message).help(format!("allowed: up to {MAX_NAME} letters, digits, `-` and `_`")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::key::PublicKey;
    use super::*;

    #[test]
    fn addresses_are_those_of_buckets() {
        let address = |url: &str| Address::parse(url, None, None);
        assert_eq!(address("s3://lab").unwrap().prefix, "");
        let deep = address("s3://lab-1/a/b_c.d/").unwrap();
        assert_eq!((deep.bucket.as_str(), deep.prefix.as_str()), ("lab-1", "a/b_c.d"));
        assert_eq!(deep.url(), "s3://lab-1/a/b_c.d");
        for wrong in [
            "lab",
            "http://lab",
            "s3://",
            "s3:///a",
            "s3://lab/../x",
            "s3://lab/a//b",
            "s3://lab/a b",
            "s3://l?b",
        ] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
        for endpoint in [
            "minio:9000",
            "https://",
            "https://a b",
            "ftp://a",
            "https://u@h",
            "http://h?x",
        ] {
            assert!(Address::parse("s3://lab", Some(endpoint), None).is_err(), "{endpoint}");
        }
        let there = Address::parse("s3://lab", Some("http://127.0.0.1:9000/"), Some("eu-west-1")).unwrap();
        assert_eq!(there.endpoint.as_deref(), Some("http://127.0.0.1:9000"));
        assert_ne!(there.digest(), address("s3://lab").unwrap().digest());
    }

    #[test]
    fn a_remote_is_remembered_until_it_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let configuration = Configuration::in_folder(&folder.path().join("new"));
        assert!(configuration.names().unwrap().is_empty() && configuration.find("lab").unwrap().is_none());
        let address = Address::parse("s3://lab/store", Some("https://h:1"), None).unwrap();
        let key: PublicKey = "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c"
            .parse()
            .unwrap();
        let named = TrustedKey {
            key,
            owner: "anna".to_owned(),
        };
        configuration
            .add("lab", &address, std::slice::from_ref(&named), false)
            .unwrap();
        configuration
            .add("lab", &address, std::slice::from_ref(&named), false)
            .unwrap();
        let found = configuration.find("lab").unwrap().unwrap();
        assert_eq!((found.address, found.trusted), (address.clone(), vec![named.clone()]));
        assert_eq!(configuration.names().unwrap(), ["lab"]);
        let other = Address::parse("s3://other", None, None).unwrap();
        assert!(
            configuration
                .add("lab", &other, std::slice::from_ref(&named), false)
                .is_err()
        );
        assert!(
            configuration
                .add("a/b", &other, std::slice::from_ref(&named), true)
                .is_err()
        );
        // Other trusted keys and another address replace it if that is asked for.
        assert!(configuration.add("lab", &address, &[], false).is_err());
        configuration.add("lab", &other, &[named], true).unwrap();
        assert_eq!(configuration.find("lab").unwrap().unwrap().address, other);
        assert!(configuration.remove("lab").unwrap() && !configuration.remove("lab").unwrap());
    }
}
