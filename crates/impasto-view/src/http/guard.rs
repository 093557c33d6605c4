//! Who may ask: the page that this program serves, from this machine, or with the token.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use rand::TryRng;
use rand::rngs::SysRng;

use super::gate::Pulse;
use super::reply::Refusal;

/// Where pages listen.
pub(super) const STREAM: &str = "/api/stream";
/// Bytes of a token.
const TOKEN: usize = 16;

/// What requests are held against.
#[derive(Debug)]
pub(crate) struct AccessGuard {
    /// Needed, if there is one.
    token: Option<String>,
    port: u16,
}

impl AccessGuard {
    pub(crate) fn new(token: bool, port: u16) -> std::io::Result<Self> {
        let token = token.then(random_token).transpose()?;
        Ok(Self { token, port })
    }

    /// The token, if one is needed.
    pub(crate) fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    fn cookie(&self) -> String {
        // Cookies do not know ports.
        format!("impasto-{}", self.port)
    }

    /// Refuses names that lead here without being ours: that is how pages of others reach programs
    /// on this machine.
    fn check_host<'a>(&self, headers: &'a HeaderMap) -> Result<&'a str, Refusal> {
        let host = headers.get(header::HOST).and_then(|h| h.to_str().ok());
        let host = host.ok_or_else(|| Refusal::wrong("the request does not say its Host"))?;
        match name_of(host) {
            "localhost" => Ok(host),
            name => match name.parse::<IpAddr>() {
                Ok(address) if address.is_loopback() || self.token.is_some() => Ok(host),
                _ => Err(Refusal::new(
                    StatusCode::FORBIDDEN,
                    "this studio does not go by that name; open the address that the program prints",
                )),
            },
        }
    }

    /// Refuses pages of others.
    fn check_origin(headers: &HeaderMap, host: &str) -> Result<(), Refusal> {
        let Some(origin) = headers.get(header::ORIGIN) else {
            return Ok(());
        };
        let own = origin
            .to_str()
            .ok()
            .and_then(|o| o.strip_prefix("http://"))
            .is_some_and(|o| o.eq_ignore_ascii_case(host));
        if own {
            return Ok(());
        }
        Err(Refusal::new(
            StatusCode::FORBIDDEN,
            "another page asked for this; only the studio's own page may",
        ))
    }

    /// Where the right token was given; `None` where none is needed.
    fn check_token(&self, headers: &HeaderMap, uri: &Uri) -> Result<Option<Given>, Refusal> {
        let Some(token) = &self.token else {
            return Ok(None);
        };
        let is_right = |given: &str| same(given.as_bytes(), token.as_bytes());
        let bearer = headers.get(header::AUTHORIZATION);
        let bearer = bearer.and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        if bearer.is_some_and(is_right) {
            return Ok(Some(Given::Header));
        }
        let name = self.cookie();
        let cookies = headers.get_all(header::COOKIE).into_iter();
        let mut cookies = cookies
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'))
            .filter_map(|cookie| cookie.trim().strip_prefix(&name)?.strip_prefix('='));
        let in_address = uri.query().unwrap_or_default().split('&');
        let mut in_address = in_address.filter_map(|part| part.strip_prefix("token="));
        if in_address.any(is_right) {
            return Ok(Some(Given::Address));
        }
        if cookies.any(is_right) {
            return Ok(Some(Given::Header));
        }
        Err(Refusal::new(
            StatusCode::UNAUTHORIZED,
            "this studio needs its token: open the whole address that the program prints",
        ))
    }
}

/// How a token came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Given {
    /// In the address, where it should not stay.
    Address,
    /// As a cookie or as a header of its own.
    Header,
}

fn random_token() -> std::io::Result<String> {
    let mut bytes = [0; TOKEN];
    SysRng
        .try_fill_bytes(&mut bytes)
        .map_err(std::io::Error::other)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The host without its port.
fn name_of(host: &str) -> &str {
    match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    }
}

/// Whether two texts are the same, in a time that does not say where they differ.
fn same(a: &[u8], b: &[u8]) -> bool {
    let differences = a.iter().zip(b).fold(0, |all, (a, b)| all | (a ^ b));
    a.len() == b.len() && std::hint::black_box(differences) == 0
}

/// Stands before everything else.
pub(super) async fn watch(
    State(guard): State<Arc<AccessGuard>>,
    request: Request,
    next: Next,
) -> Response {
    let pulse = request.extensions().get::<ConnectInfo<Pulse>>();
    let pulse = pulse.map(|ConnectInfo(pulse)| pulse.clone());
    if let Some(pulse) = &pulse {
        pulse.busy();
    }
    let is_page = !request.uri().path().starts_with("/api/");
    let host = request.headers().get(header::HOST).cloned();
    let mut response = match admit(&guard, &request) {
        Err(refusal) => refusal.into_response(),
        Ok(Some(Given::Address)) if is_page => {
            let mut response = StatusCode::SEE_OTHER.into_response();
            let home = HeaderValue::from_static("/");
            response.headers_mut().insert(header::LOCATION, home);
            with_cookie(&guard, response)
        }
        Ok(Some(Given::Address)) => with_cookie(&guard, next.run(request).await),
        Ok(_) => next.run(request).await,
    };
    harden(response.headers_mut(), host.as_ref(), is_page);
    if let Some(pulse) = &pulse
        && response.status() != StatusCode::SWITCHING_PROTOCOLS
    {
        pulse.idle();
    }
    response
}

fn admit(guard: &AccessGuard, request: &Request) -> Result<Option<Given>, Refusal> {
    let headers = request.headers();
    let host = guard.check_host(headers)?;
    let reads = matches!(*request.method(), Method::GET | Method::HEAD);
    if !reads || request.uri().path() == STREAM {
        AccessGuard::check_origin(headers, host)?;
    }
    guard.check_token(headers, request.uri())
}

fn with_cookie(guard: &AccessGuard, mut response: Response) -> Response {
    let token = guard.token().unwrap_or_default();
    let cookie = format!(
        "{}={token}; Path=/; HttpOnly; SameSite=Strict",
        guard.cookie()
    );
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}

/// Tells browsers what the page may do: nothing but talk with this program.
fn harden(headers: &mut HeaderMap, host: Option<&HeaderValue>, is_page: bool) {
    // Checked when the request was let in; what was not is left out.
    let own = host.and_then(|host| host.to_str().ok());
    let plain = |host: &&str| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "[]:.-".contains(c);
        host.chars().all(plain)
    };
    let socket = own.filter(plain).map(|host| format!(" ws://{host}"));
    let policy = format!(
        "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'{}; object-src 'none'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        socket.unwrap_or_default()
    );
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    let caching = if is_page { "no-cache" } else { "no-store" };
    for (name, value) in [
        (header::CACHE_CONTROL, caching),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.insert(
        "cross-origin-resource-policy",
        HeaderValue::from_static("same-origin"),
    );
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs.iter();
        pairs
            .map(|(name, value)| {
                (
                    name.parse::<header::HeaderName>().unwrap(),
                    value.parse().unwrap(),
                )
            })
            .collect()
    }

    #[test]
    fn only_own_names_are_answered() {
        let closed = AccessGuard::new(false, 7007).unwrap();
        let open = AccessGuard::new(true, 7007).unwrap();
        let is_ours =
            |guard: &AccessGuard, host: &str| guard.check_host(&headers(&[("host", host)])).is_ok();
        for host in [
            "localhost",
            "localhost:7007",
            "127.0.0.1:7007",
            "[::1]:7007",
            "127.0.0.1:80",
        ] {
            assert!(is_ours(&closed, host) && is_ours(&open, host), "{host}");
        }
        for host in [
            "evil.example",
            "localhost.evil.example:7007",
            "127.0.0.1.evil.example",
            "",
            ":1",
        ] {
            assert!(!is_ours(&closed, host) && !is_ours(&open, host), "{host}");
        }
        assert!(!is_ours(&closed, "192.168.0.7:7007") && is_ours(&open, "192.168.0.7:7007"));
        assert!(closed.check_host(&HeaderMap::new()).is_err());
    }

    #[test]
    fn other_pages_are_refused() {
        let comes = |origin: &str| {
            AccessGuard::check_origin(&headers(&[("origin", origin)]), "127.0.0.1:7007").is_ok()
        };
        assert!(comes("http://127.0.0.1:7007"));
        for origin in [
            "http://evil.example",
            "null",
            "http://127.0.0.1:8080",
            "https://127.0.0.1:7007",
            "",
        ] {
            assert!(!comes(origin), "{origin}");
        }
        assert!(AccessGuard::check_origin(&HeaderMap::new(), "127.0.0.1:7007").is_ok());
    }

    #[test]
    fn a_token_may_come_in_three_ways() {
        let guard = AccessGuard::new(true, 7007).unwrap();
        let token = guard.token().unwrap().to_owned();
        assert_eq!(token.len(), 32);
        assert_ne!(token, random_token().unwrap());
        let check = |pairs: &[(&'static str, &str)], uri: &str| {
            guard.check_token(&headers(pairs), &uri.parse().unwrap())
        };
        let given = |pairs: &[(&'static str, &str)], uri: &str| check(pairs, uri).ok().flatten();
        let bearer = format!("Bearer {token}");
        assert_eq!(
            given(&[("authorization", &bearer)], "/"),
            Some(Given::Header)
        );
        let cookie = format!("a=b; impasto-7007={token}; c=d");
        assert_eq!(given(&[("cookie", &cookie)], "/"), Some(Given::Header));
        assert_eq!(
            given(&[], &format!("/?x=1&token={token}")),
            Some(Given::Address)
        );
        for wrong in ["", "x", &token[1..], &format!("{token}0")] {
            assert!(check(&[], &format!("/?token={wrong}")).is_err(), "{wrong}");
            assert!(check(&[("cookie", &format!("impasto-7007={wrong}"))], "/").is_err());
        }
        assert!(check(&[("cookie", &format!("impasto-7008={token}"))], "/").is_err());
        let closed = AccessGuard::new(false, 7007).unwrap();
        assert!(
            closed
                .check_token(&HeaderMap::new(), &"/".parse().unwrap())
                .unwrap()
                .is_none()
        );
    }
}
