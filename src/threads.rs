//! How soon a thread wants the processor when it has something to do. How much of it is another
//! matter: a share is the same for all, except for the trainers, whose nice value is a setting.

/// What waits for a thread's work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Urgency {
    /// Somebody, for work that takes well under a millisecond: messages, small questions.
    Prompt,
    /// Somebody, for work that takes longer: large questions.
    Usual,
    /// Nobody, until milliseconds of it are done: fusing frames, training.
    Patient,
}

impl Urgency {
    /// Tells the system about the calling thread. A thread that wakes takes the processor at once from
    /// one that is more patient, where it would wait for the end of a time slice, and again for each
    /// message on its way. Linux knows this since 6.12; earlier ones and other systems take no notice.
    pub fn declare(self) {
        #[cfg(target_os = "linux")]
        if let Err(error) = set_slice(self.slice_ns()) {
            // A sandbox may forbid it. All that it costs is time.
            tracing::debug!(%error, urgency = ?self, "the system was not told how urgent a thread is");
        }
    }

    /// The time slice that the thread asks for. The system's own is between 0.7 and 2.8 ms, by the
    /// number of cores: the others stand clear of both ends.
    #[cfg(target_os = "linux")]
    fn slice_ns(self) -> u64 {
        match self {
            Self::Prompt => 400_000,
            Self::Usual => 0, // its own
            Self::Patient => 5_000_000,
        }
    }
}

#[cfg(target_os = "linux")]
fn set_slice(slice_ns: u64) -> std::io::Result<()> {
    let attributes = libc::sched_attr {
        size: size_of::<libc::sched_attr>() as u32,
        sched_policy: 0,
        sched_flags: libc::SCHED_FLAG_KEEP_POLICY as u64,
        sched_nice: rustix::process::getpriority_process(None)?,
        sched_priority: 0,
        sched_runtime: slice_ns,
        sched_deadline: 0,
        sched_period: 0,
    };
    // SAFETY: the call reads the attributes, whose size they tell and which outlive it, and changes
    // nothing but the calling thread (0).
    match unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// Policy, nice value and slice of the calling thread.
    fn attributes() -> (u32, i32, u64) {
        let mut read = std::mem::MaybeUninit::<libc::sched_attr>::zeroed();
        let size = size_of::<libc::sched_attr>();
        // SAFETY: the call writes at most `size` bytes; all bits zero are attributes too.
        let read = unsafe {
            let outcome = libc::syscall(libc::SYS_sched_getattr, 0, read.as_mut_ptr(), size, 0);
            assert_eq!(outcome, 0, "{}", std::io::Error::last_os_error());
            read.assume_init()
        };
        (read.sched_policy, read.sched_nice, read.sched_runtime)
    }

    #[test]
    fn a_slice_changes_and_nothing_else() {
        let told = |urgency: Urgency| {
            std::thread::spawn(move || {
                rustix::process::setpriority_process(None, 7).expect("less than it had");
                urgency.declare();
                attributes()
            })
        };
        let [prompt, usual, patient] = [Urgency::Prompt, Urgency::Usual, Urgency::Patient]
            .map(|urgency| told(urgency).join().expect("a thread"));
        let policy = attributes().0;
        for (policy_now, nice, _) in [prompt, usual, patient] {
            assert_eq!((policy_now, nice), (policy, 7));
        }
        // A system that takes no notice says 0.
        assert!(
            prompt.2 < usual.2 && usual.2 < patient.2 || patient.2 == 0,
            "{prompt:?} {usual:?}"
        );
    }
}
