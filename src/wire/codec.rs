//! Between gRPC's bytes and messages.

use prost::Message;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, DecodeBuf, Decoder};
use tonic_prost::ProstCodec;

use crate::error::{self, Error};

/// Protobuf, with the refusal that a message deserves which is none: INVALID_ARGUMENT, like every
/// other wrong input. gRPC libraries say INTERNAL, which reads as the server's own fault.
#[derive(Debug, Clone)]
pub struct Messages<E, D>(ProstCodec<E, D>);

impl<E, D> Default for Messages<E, D> {
    fn default() -> Self {
        Self(ProstCodec::new())
    }
}

impl<E, D> Codec for Messages<E, D>
where
    E: Message + Send + 'static,
    D: Message + Default + Send + 'static,
{
    type Encode = E;
    type Decode = D;
    type Encoder = <ProstCodec<E, D> as Codec>::Encoder;
    type Decoder = Checked<<ProstCodec<E, D> as Codec>::Decoder>;

    fn encoder(&mut self) -> Self::Encoder {
        self.0.encoder()
    }

    fn decoder(&mut self) -> Self::Decoder {
        Checked(self.0.decoder())
    }
}

/// Reads a message that came as it is, without a codec around it.
pub fn read_message<M: Message + Default>(bytes: impl bytes::Buf) -> error::Result<M> {
    M::decode(bytes).map_err(|e| Error::invalid("message", format!("is no valid protobuf: {e}")))
}

/// A decoder whose failures are the sender's.
#[derive(Debug)]
pub struct Checked<D>(D);

impl<D: Decoder<Error = Status>> Decoder for Checked<D> {
    type Item = D::Item;
    type Error = Status;

    fn decode(&mut self, buffer: &mut DecodeBuf<'_>) -> Result<Option<D::Item>, Status> {
        self.0.decode(buffer).map_err(|status| {
            Status::invalid_argument(format!("message: is no valid protobuf: {}", status.message()))
        })
    }

    fn buffer_settings(&self) -> BufferSettings {
        self.0.buffer_settings()
    }
}
