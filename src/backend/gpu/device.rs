//! The adapter that is used, and the device on it.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};

/// What a kernel of a step needs at least: bytes of workgroup memory, invocations of a workgroup,
/// storage buffers.
const WORKGROUP_BYTES: u32 = 32 << 10;
const INVOCATIONS: u32 = 128;
const STORAGE_BUFFERS: u32 = 14;

/// Which adapters are acceptable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Adapters {
    /// Hardware alone.
    Hardware,
    /// Also Vulkan in software, which is slower than the CPU backend: for tests.
    Any,
}

/// An adapter that the machine has.
#[derive(Debug, Clone)]
pub struct AdapterReport {
    pub name: String,
    pub driver: String,
    /// "discrete GPU", "software", ...
    pub kind: &'static str,
    pub is_hardware: bool,
    /// Why it cannot be used, if it cannot.
    pub unfit: Option<String>,
    /// What kernels depend on, by name.
    pub limits: Vec<(&'static str, u64)>,
    /// Whether it has timestamps.
    pub has_timestamps: bool,
}

/// Every adapter of the machine that speaks Vulkan.
pub fn adapters() -> Vec<AdapterReport> {
    let report = |adapter: wgpu::Adapter| {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        AdapterReport {
            unfit: unfit(&adapter, Adapters::Any),
            is_hardware: is_hardware(info.device_type),
            kind: kind(info.device_type),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            name: info.name,
            limits: vec![
                ("bytes of a binding", limits.max_storage_buffer_binding_size),
                ("bytes of a buffer", limits.max_buffer_size),
                ("bytes of workgroup memory", limits.max_compute_workgroup_storage_size.into()),
                ("invocations of a workgroup", limits.max_compute_invocations_per_workgroup.into()),
                ("storage buffers of a kernel", limits.max_storage_buffers_per_shader_stage.into()),
            ],
            has_timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        }
    };
    found().into_iter().map(report).collect()
}

/// A device and its queue.
#[derive(Debug)]
pub(super) struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) info: wgpu::AdapterInfo,
    /// ns a tick of a timestamp; `None` where there are none.
    pub(super) tick_ns: Option<f32>,
    /// Why the device is lost or out of order.
    fault: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens the best adapter.
    pub(super) fn open(adapters: Adapters) -> Result<Self> {
        let adapter = choose(adapters)?;
        let info = adapter.get_info();
        let timestamps = wgpu::Features::TIMESTAMP_QUERY & adapter.features();
        let opened = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("orenx"),
            required_features: timestamps,
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(opened)
            .map_err(|e| Error::DeviceLost(format!("{} does not open: {e}", info.name)))?;
        let fault = Arc::new(Mutex::new(None));
        let (lost, wrong) = (fault.clone(), fault.clone());
        device.set_device_lost_callback(move |reason, message| {
            // A device that this process gives up itself is not lost.
            if reason != wgpu::DeviceLostReason::Destroyed {
                note(&lost, format!("the device is lost: {message}"));
            }
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            note(&wrong, error.to_string());
        }));
        let tick_ns = (!timestamps.is_empty()).then(|| queue.get_timestamp_period());
        Ok(Self { device, queue, info, tick_ns, fault })
    }

    /// Fails once the device is lost or has refused something.
    pub(super) fn check(&self) -> Result<()> {
        match &*self.fault.lock().unwrap_or_else(PoisonError::into_inner) {
            None => Ok(()),
            Some(fault) => Err(Error::DeviceLost(format!("{}: {fault}", self.info.name))),
        }
    }

    /// A buffer for kernels, zero at first. Fails if there is no memory for it.
    pub(super) fn buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        use wgpu::BufferUsages as U;
        self.allocate(label, bytes, U::STORAGE | U::UNIFORM | U::COPY_SRC | U::COPY_DST)
    }

    /// A buffer for kernels that holds `words`; `None` for no words.
    pub(super) fn upload(&self, label: &str, words: &[u32]) -> Result<Option<wgpu::Buffer>> {
        if words.is_empty() {
            return Ok(None);
        }
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let buffer = self.buffer(label, bytes.len() as u64)?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(Some(buffer))
    }

    /// A buffer that the host reads.
    pub(super) fn read_buffer(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        use wgpu::BufferUsages as U;
        self.allocate(label, bytes, U::MAP_READ | U::COPY_DST)
    }

    /// Most bytes of one buffer that a kernel can bind.
    pub(super) fn most_bytes(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
    }

    fn allocate(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        let most = self.most_bytes();
        if bytes > most {
            return Err(Error::ResourceExhausted {
                what: format!("{label} on {}", self.info.name),
                limit: format!("{bytes} bytes are more than a binding's {most}"),
            });
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(4).max(4),
            usage,
            mapped_at_creation: false,
        });
        match pollster::block_on(scope.pop()) {
            None => Ok(buffer),
            Some(_) => Err(Error::ResourceExhausted {
                what: format!("{label} on {}", self.info.name),
                limit: format!("there is no memory for {bytes} bytes"),
            }),
        }
    }

    /// Overwrites the beginning of a buffer, before what is submitted next.
    pub(super) fn write<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, values: &[T]) {
        if !values.is_empty() {
            self.queue.write_buffer(buffer, 0, bytemuck::cast_slice(values));
        }
    }

    /// Reads the first `count` values of a buffer; waits for everything that was submitted.
    pub(super) fn read<T: bytemuck::Pod>(
        &self,
        buffer: &wgpu::Buffer,
        count: usize,
    ) -> Result<Vec<T>> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.read_buffer("readback", bytes)?;
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, Some(bytes));
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        self.wait()?;
        let view = staging
            .get_mapped_range(..)
            .map_err(|e| Error::DeviceLost(format!("{}: {e}", self.info.name)))?;
        Ok(bytemuck::pod_collect_to_vec(&view))
    }

    /// What a device that is lost does.
    #[cfg(test)]
    pub(super) fn break_down(&self, why: &str) {
        note(&self.fault, why.to_owned());
    }

    /// Bytes of the device's memory in use.
    pub(super) fn allocated_bytes(&self) -> u64 {
        self.device.generate_allocator_report().map_or(0, |report| report.total_allocated_bytes)
    }

    /// Waits until everything that was submitted is done, and what it calls back is called.
    pub(super) fn wait(&self) -> Result<()> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        polled.map_err(|e| Error::DeviceLost(format!("{}: {e}", self.info.name)))?;
        self.check()
    }
}

fn note(fault: &Mutex<Option<String>>, what: String) {
    tracing::error!(%what, "gpu");
    fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(what);
}

fn found() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

/// The best adapter that has what the kernels need.
fn choose(adapters: Adapters) -> Result<wgpu::Adapter> {
    let found = found();
    let mut refused = Vec::new();
    let mut fit = Vec::new();
    for adapter in found {
        let info = adapter.get_info();
        match unfit(&adapter, adapters) {
            None => fit.push((rank(info.device_type), adapter)),
            Some(why) => refused.push(format!("{}: {why}", info.name)),
        }
    }
    // The first of the best: drivers list them in the order that the machine's owner set.
    match fit.into_iter().min_by_key(|(rank, _)| *rank) {
        Some((_, adapter)) => Ok(adapter),
        None if refused.is_empty() => Err(Error::FailedPrecondition(
            "there is no GPU: the machine has no Vulkan driver".into(),
        )),
        None => Err(Error::FailedPrecondition(format!("there is no GPU: {}", refused.join("; ")))),
    }
}

/// Why an adapter is not used.
fn unfit(adapter: &wgpu::Adapter, adapters: Adapters) -> Option<String> {
    let limits = adapter.limits();
    if adapters == Adapters::Hardware && !is_hardware(adapter.get_info().device_type) {
        return Some("it is software, slower than the CPU backend".into());
    }
    for (what, has, needs) in [
        ("bytes of workgroup memory", limits.max_compute_workgroup_storage_size, WORKGROUP_BYTES),
        ("invocations of a workgroup", limits.max_compute_invocations_per_workgroup, INVOCATIONS),
        ("storage buffers", limits.max_storage_buffers_per_shader_stage, STORAGE_BUFFERS),
    ] {
        if has < needs {
            return Some(format!("{has} {what}, {needs} are needed"));
        }
    }
    None
}

fn kind(kind: wgpu::DeviceType) -> &'static str {
    use wgpu::DeviceType as T;
    match kind {
        T::DiscreteGpu => "discrete GPU",
        T::IntegratedGpu => "integrated GPU",
        T::VirtualGpu => "virtual GPU",
        T::Cpu => "software",
        T::Other => "unknown",
    }
}

fn is_hardware(kind: wgpu::DeviceType) -> bool {
    use wgpu::DeviceType as T;
    matches!(kind, T::DiscreteGpu | T::IntegratedGpu | T::VirtualGpu)
}

fn rank(kind: wgpu::DeviceType) -> u8 {
    use wgpu::DeviceType as T;
    match kind {
        T::DiscreteGpu => 0,
        T::IntegratedGpu => 1,
        T::VirtualGpu => 2,
        T::Other | T::Cpu => 3,
    }
}
