"""Errors of Kafka: which are transient and which permanent, and their messages.

The codes are those of the protocol (https://kafka.apache.org/protocol#protocol_error_codes). Unknown errors are
retried: a retry in vain is reported as the trouble and costs only time, giving up wrongly costs events.
"""

import ssl

from aiokafka import errors

from opir_core.errors import SinkError

#: Permanent error codes: the message, the request or the permission is wrong.
FATAL_CODES = frozenset(
    {
        10,  # MESSAGE_TOO_LARGE
        17,  # INVALID_TOPIC_EXCEPTION
        18,  # RECORD_LIST_TOO_LARGE
        21,  # INVALID_REQUIRED_ACKS
        29,  # TOPIC_AUTHORIZATION_FAILED
        31,  # CLUSTER_AUTHORIZATION_FAILED
        32,  # INVALID_TIMESTAMP
        33,  # UNSUPPORTED_SASL_MECHANISM
        34,  # ILLEGAL_SASL_STATE
        35,  # UNSUPPORTED_VERSION
        42,  # INVALID_REQUEST
        43,  # UNSUPPORTED_FOR_MESSAGE_FORMAT
        44,  # POLICY_VIOLATION
        53,  # TRANSACTIONAL_ID_AUTHORIZATION_FAILED
        54,  # SECURITY_DISABLED
        58,  # SASL_AUTHENTICATION_FAILED
        76,  # UNSUPPORTED_COMPRESSION_TYPE
        87,  # INVALID_RECORD
    }
)


class UnsupportedCompressionTypeError(errors.BrokerResponseError):  # type: ignore[misc]
    """The broker cannot read the batch's compression."""

    errno = 76
    message = "UNSUPPORTED_COMPRESSION_TYPE"


class InvalidRecordError(errors.BrokerResponseError):  # type: ignore[misc]
    """The broker's checks refuse a record."""

    errno = 87
    message = "INVALID_RECORD"


# aiokafka reports codes without a class as -1, which is retried; these two are permanent.
for _unknown in (UnsupportedCompressionTypeError, InvalidRecordError):
    errors.kafka_errors.setdefault(_unknown.errno, _unknown)

_FATAL_TYPES = (
    errors.AuthenticationFailedError,
    errors.AuthenticationMethodNotSupported,
    errors.IncompatibleBrokerVersion,
    errors.UnrecognizedBrokerVersion,
    errors.UnsupportedCodecError,
    errors.KafkaConfigurationError,
    ssl.SSLCertVerificationError,
)

_REMEDIES = {
    10: "raise the topic's max.message.bytes, or lower batch_bytes",
    18: "raise the broker's segment size, or lower batch_bytes",
    29: "let this login write to the topic, or give another topic",
    31: "let this login write to the topic (brokers before 2.8 ask for IdempotentWrite on the cluster too)",
    58: "see security.username and the variable of its password",
    76: "give another compression",
    35: "the broker is too old for idempotent producers; Kafka has them from 0.11 on",
}


#: The broker or the topic takes no batches of that size; it may take smaller ones.
TOO_LARGE = tuple(errors.for_code(code) for code in (10, 18))


class SmallerBatchesError(errors.KafkaError):  # type: ignore[misc]
    """A batch was too large; smaller ones follow."""


def is_fatal(error: BaseException) -> bool:
    """Return whether an error is permanent."""
    return isinstance(error, _FATAL_TYPES) or (getattr(error, "errno", None) in FATAL_CODES and _is_answer(error))


def words(error: BaseException, servers: str) -> str:
    """Return the message for an error, without secrets."""
    if isinstance(error, SinkError):
        return str(error)
    if isinstance(error, TimeoutError | errors.RequestTimedOutError | errors.KafkaTimeoutError):
        return f"no answer from {servers} in time"
    if _is_answer(error):
        code: int = getattr(error, "errno", -1)
        remedy = f"; {_REMEDIES[code]}" if code in _REMEDIES else ""
        return f"{servers} answers {type(error).__name__} (code {code}){remedy}"
    if isinstance(error, SmallerBatchesError):
        return f"{servers} refuses a batch as too large; sending smaller ones"
    if isinstance(error, ssl.SSLError):
        return f"no encrypted connection to {servers}: {error.reason or 'TLS fails'}; see security.ca_file"
    if isinstance(error, errors.AuthenticationFailedError):
        return f"{servers} refuses the login; see security.username and the variable of its password"
    if isinstance(error, errors.IncompatibleBrokerVersion | errors.UnrecognizedBrokerVersion):
        return f"{servers} does not know what the settings ask for, a login perhaps, or is too old"
    if isinstance(error, OSError | errors.KafkaConnectionError):
        return f"no broker answers at {servers}"
    return f"{servers}: {type(error).__name__}"


def _is_answer(error: BaseException) -> bool:
    return isinstance(error, errors.BrokerResponseError)
