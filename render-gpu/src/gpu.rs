//! The host's device, looked at once: are its limits enough, and does creating things succeed.

use wgpu::{Device, ErrorFilter, Features, Limits, Queue};

use crate::GpuError;

/// A device and its queue, found fit for the kernels of this crate. Cheap to clone; the host keeps its own.
///
/// Nothing here changes the device: no callback of the host's is replaced, and what is created is created
/// within error scopes, so that a refusal becomes a [`GpuError`] and neither a panic nor a message to the
/// host's handler.
#[derive(Clone, Debug)]
pub struct Gpu {
    device: Device,
    queue: Queue,
}

/// The limits that kernels of this crate need: WebGPU's defaults, or less. Ask for at least these when
/// requesting a device.
///
/// `max_storage_buffer_binding_size` decides how many lights there can be: 128 MiB are enough for two
/// million; `max_texture_dimension_2d` how many triangles: 8192 for 22 million.
pub fn required_limits() -> Limits {
    Limits::default()
}

/// A limit that kernels use, and the least that will do.
type Need = (&'static str, u64, fn(&Limits) -> u64);

/// What kernels really use of [`required_limits`].
const NEEDS: [Need; 9] = [
    ("max_storage_buffers_per_shader_stage", 8, |l| l.max_storage_buffers_per_shader_stage.into()),
    ("max_storage_textures_per_shader_stage", 2, |l| l.max_storage_textures_per_shader_stage.into()),
    ("max_uniform_buffers_per_shader_stage", 2, |l| l.max_uniform_buffers_per_shader_stage.into()),
    ("max_bind_groups", 4, |l| l.max_bind_groups.into()),
    ("max_compute_workgroup_storage_size", 16384, |l| l.max_compute_workgroup_storage_size.into()),
    ("max_compute_invocations_per_workgroup", 256, |l| l.max_compute_invocations_per_workgroup.into()),
    ("max_compute_workgroup_size_x", 256, |l| l.max_compute_workgroup_size_x.into()),
    ("max_compute_workgroups_per_dimension", 65535, |l| l.max_compute_workgroups_per_dimension.into()),
    ("max_storage_buffer_binding_size", 1 << 20, |l| l.max_storage_buffer_binding_size),
];

impl Gpu {
    /// The host's device and queue.
    ///
    /// # Errors
    /// [`GpuError::Limit`]: the first limit that is too small. No feature is needed.
    pub fn new(device: &Device, queue: &Queue) -> Result<Self, GpuError> {
        let limits = device.limits();
        for (limit, needed, of) in NEEDS {
            let available = of(&limits);
            if available < needed {
                return Err(GpuError::Limit { limit, needed, available });
            }
        }
        Ok(Self { device: device.clone(), queue: queue.clone() })
    }

    /// A device of its own, for tools and tests: the best adapter there is, software included, with
    /// [`required_limits`], and timestamps where the adapter has them. Blocks.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`], [`GpuError::NoDevice`].
    pub fn request() -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let options = wgpu::RequestAdapterOptions::default();
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| GpuError::NoAdapter(error.to_string()))?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("lighttree"),
            required_features: adapter.features() & Features::TIMESTAMP_QUERY,
            required_limits: required_limits(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::NoDevice(error.to_string()))?;
        Self::new(&device, &queue)
    }

    /// The device.
    pub const fn device(&self) -> &Device {
        &self.device
    }

    /// Its queue.
    pub const fn queue(&self) -> &Queue {
        &self.queue
    }

    /// Creates `what`, and turns whatever the device has against it into an error.
    pub(crate) fn create<T>(
        &self,
        what: impl Fn() -> String,
        create: impl FnOnce(&Device) -> T,
    ) -> Result<T, GpuError> {
        let scopes = [ErrorFilter::Internal, ErrorFilter::Validation, ErrorFilter::OutOfMemory]
            .map(|filter| self.device.push_error_scope(filter));
        let made = create(&self.device);
        // The last scope pushed is the first popped; all of them have to be, whatever the first says.
        let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
        match errors.fold(None, |first, next| first.or(next)) {
            None => Ok(made),
            Some(_) if self.is_lost() => Err(GpuError::DeviceLost),
            Some(wgpu::Error::OutOfMemory { .. }) => Err(GpuError::OutOfMemory { what: what() }),
            Some(wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. }) => {
                Err(GpuError::Refused { what: what(), reason: description })
            }
        }
    }

    /// Whether nothing can be created on the device any more. wgpu tells only a callback, of which there is
    /// one, and that is the host's.
    fn is_lost(&self) -> bool {
        let scope = self.device.push_error_scope(ErrorFilter::Validation);
        let probe = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("probe"),
            size: 16,
            usage: wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: true,
        });
        // What is made on a lost device is not there, without an error.
        let lost = probe.get_mapped_range(..).is_err();
        lost | pollster::block_on(scope.pop()).is_some()
    }
}
