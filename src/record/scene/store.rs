//! The messages of one store of the viewer: a recording or a blueprint.
//!
//! Rerun numbers chunks and rows by the clock. Here they are counted from one, so that equal content gives equal bytes;
//! within a store they only have to differ and to grow.

use re_sdk::external::re_log_types::external::re_tuid::Tuid;
use re_sdk::external::re_log_types::{
    BlueprintActivationCommand, NonMinI64, SetStoreInfo, StoreInfo, StoreSource, TimeInt,
};
use re_sdk::log::{Chunk, ChunkError, ChunkId, LogMsg, RowId, TimeColumn};
use re_sdk::time::{TimePoint, Timeline};
use re_sdk::{
    ApplicationId, AsComponents, EntityPath, RecordingInfo, SerializationError,
    SerializedComponentColumn, StoreId,
};

use crate::units::Seconds;

use super::seconds;

/// Why a scene cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("the viewer's format does not take a chunk: {0}")]
    Chunk(#[from] ChunkError),
    #[error("the viewer's format does not take a value: {0}")]
    Value(#[from] SerializationError),
    #[error("cannot encode the scene: {0}")]
    Encode(#[from] re_sdk::external::re_log_encoding::EncodeError),
    #[error("`{name}` has {found} values in a row, expected {expected}")]
    Width { name: String, found: usize, expected: usize },
    #[error("cannot start the viewer `{program}`: {source}")]
    Spawn { program: String, source: std::io::Error },
    #[error("`{url}` is no address of a viewer: {what}")]
    Address { url: String, what: String },
    #[error("the viewer at `{url}` took nothing: {what}")]
    Lost { url: String, what: String },
    #[error(transparent)]
    File(#[from] crate::files::FileError),
}

/// A store being filled.
pub(super) struct Store {
    id: StoreId,
    messages: Vec<LogMsg>,
    count: u64,
}

impl Store {
    /// A recording called `name` in the viewer.
    pub(super) fn recording(
        application: &str,
        recording: &str,
        name: &str,
    ) -> Result<Self, SceneError> {
        let mut store =
            Self::new(StoreId::recording(ApplicationId::new_or_unknown(application), recording));
        let about = RecordingInfo::update_fields().with_name(name);
        store.fixed(EntityPath::properties(), &about)?;
        Ok(store)
    }

    pub(super) fn new(id: StoreId) -> Self {
        let source =
            StoreSource::Other(concat!("arnold-analyze ", env!("CARGO_PKG_VERSION")).into());
        let mut store = Self { id, messages: Vec::new(), count: 0 };
        let row_id = store.next();
        let info = StoreInfo::new(store.id.clone(), source);
        store.messages.push(LogMsg::SetStoreInfo(SetStoreInfo { row_id, info }));
        store
    }

    /// The next number.
    fn next(&mut self) -> Tuid {
        self.count += 1;
        Tuid::from_nanos_and_inc(1, self.count)
    }

    /// Says something that holds at all times.
    pub(super) fn fixed(
        &mut self,
        path: impl Into<EntityPath>,
        what: &dyn AsComponents,
    ) -> Result<(), SceneError> {
        self.row(path, TimePoint::default(), what)
    }

    /// Says something at one time.
    pub(super) fn row(
        &mut self,
        path: impl Into<EntityPath>,
        at: TimePoint,
        what: &dyn AsComponents,
    ) -> Result<(), SceneError> {
        let (chunk, row) = (ChunkId::from_tuid(self.next()), RowId::from_tuid(self.next()));
        let chunk = Chunk::builder_with_id(chunk, path).with_archetype(row, at, what).build()?;
        self.push(&chunk)
    }

    /// Says something at each of `steps`.
    pub(super) fn rows(
        &mut self,
        path: impl Into<EntityPath>,
        steps: &[usize],
        interval: Seconds,
        columns: impl Iterator<Item = SerializedComponentColumn>,
    ) -> Result<(), SceneError> {
        let chunk = ChunkId::from_tuid(self.next());
        let rows: Vec<RowId> = steps.iter().map(|_| RowId::from_tuid(self.next())).collect();
        let times = |timeline: Timeline, of: &dyn Fn(usize) -> i64| {
            let mut builder = TimeColumn::builder(timeline);
            for &step in steps {
                builder.with_row(NonMinI64::new(of(step)).unwrap_or(NonMinI64::MIN));
            }
            (*timeline.name(), builder.build())
        };
        let nanoseconds = |step| (seconds(step, interval) * 1e9).round() as i64;
        let timelines = [
            times(Timeline::new_duration(TIME), &nanoseconds),
            times(Timeline::new_sequence(STEP), &|step| step as i64),
        ];
        let chunk = Chunk::from_native_row_ids(
            chunk,
            path.into(),
            Some(true),
            &rows,
            timelines.into_iter().collect(),
            columns.collect(),
        )?;
        self.push(&chunk)
    }

    fn push(&mut self, chunk: &Chunk) -> Result<(), SceneError> {
        let message = chunk.to_arrow_msg()?;
        self.messages.push(LogMsg::ArrowMsg(self.id.clone(), message));
        Ok(())
    }

    /// Makes the blueprint in this store the one that is shown.
    pub(super) fn activate(&mut self) {
        let command = BlueprintActivationCommand {
            blueprint_id: self.id.clone(),
            make_active: true,
            make_default: true,
        };
        self.messages.push(LogMsg::BlueprintActivationCommand(command));
    }

    /// The messages since the last time.
    pub(super) fn take(&mut self) -> Vec<LogMsg> {
        std::mem::take(&mut self.messages)
    }
}

/// The timelines.
pub(super) const TIME: &str = "time";
pub(super) const STEP: &str = "step";

/// The only time of a blueprint.
pub(super) fn blueprint_time() -> TimePoint {
    TimePoint::default().with(Timeline::new_sequence("blueprint"), TimeInt::ZERO)
}
