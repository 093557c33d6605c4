//! Whose a folder is that several processes write to, one after the other or at once.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::atomic::put_new;
use crate::cli::CliError;

/// The file that says so.
pub const JOB_FILE: &str = "job.json";

/// Takes `folder`, which is there, for a job, or finds that it has been taken for it already.
/// `others` names a file that would be a job's, if there is one and it was there before this call.
///
/// # Errors
/// When it is another job's, or nobody's although there is such a file.
pub fn claim(folder: &Path, job: &Value, others: Option<&str>) -> Result<(), CliError> {
    let path = folder.join(JOB_FILE);
    if !path.exists() {
        if let Some(name) = others {
            return Err(CliError::Refused(format!(
                "{} holds {name} but no {JOB_FILE} that says of what it is; choose another folder \
                 or remove this one",
                folder.display()
            )));
        }
        if put_new(&path, format!("{job:#}\n").as_bytes())? {
            return Ok(());
        }
    }
    match differences(folder, job)? {
        None => Ok(()),
        Some(what) => Err(CliError::Refused(format!(
            "{} belongs to another job ({what}); choose another folder or remove this one",
            folder.display()
        ))),
    }
}

/// What distinguishes a job from the one that `folder` was taken for, in words; `None` if nothing
/// does.
pub fn differences(folder: &Path, job: &Value) -> Result<Option<String>, CliError> {
    let path = folder.join(JOB_FILE);
    let text = fs::read(&path).map_err(CliError::read(&path))?;
    // Numbers are compared as they read from a file.
    let job: Option<Value> = serde_json::from_str(&job.to_string()).ok();
    let (Ok(Value::Object(found)), Some(Value::Object(job))) = (serde_json::from_slice(&text), job)
    else {
        return Ok(Some(format!("its {JOB_FILE} cannot be understood")));
    };
    let mut keys: Vec<&str> = found.keys().chain(job.keys()).map(String::as_str).collect();
    keys.sort_unstable();
    keys.dedup();
    keys.retain(|key| found.get(*key) != job.get(*key));
    Ok((!keys.is_empty()).then(|| format!("what differs: {}", keys.join(", "))))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_first_takes_the_folder_and_others_are_told_what_differs() {
        let folder = tempfile::tempdir().unwrap();
        let job = json!({"model": "a", "strength": 0.3_f32, "styles": ["x"]});
        claim(folder.path(), &job, None).unwrap();
        // The frames that are there by now are the job's own.
        claim(folder.path(), &job, Some("0000.png")).unwrap();
        let other = json!({"model": "b", "strength": 0.3_f32, "depth": true, "styles": ["x"]});
        let problem = claim(folder.path(), &other, None).unwrap_err().to_string();
        assert!(problem.contains("differs: depth, model)"), "{problem}");
        fs::write(folder.path().join(JOB_FILE), "{").unwrap();
        let problem = claim(folder.path(), &job, None).unwrap_err().to_string();
        assert!(problem.contains("cannot be understood"), "{problem}");
    }

    #[test]
    fn frames_of_nobody_are_not_taken_over() {
        let folder = tempfile::tempdir().unwrap();
        let problem = claim(folder.path(), &json!({}), Some("0000.png")).unwrap_err();
        assert!(problem.to_string().contains("0000.png"), "{problem}");
        assert!(!folder.path().join(JOB_FILE).exists());
    }
}
