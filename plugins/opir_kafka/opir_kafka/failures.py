"""Errors of Kafka: which are transient and which permanent, and their messages.

The codes are those of the protocol (https://kafka.apache.org/protocol#protocol_error_codes).
Unknown errors are retried: a retry in vain is reported as the trouble and costs only time, giving
up wrongly costs events.
"""

import ssl
from asyncio import IncompleteReadError

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


class RegistryRefusalError(SinkError):
    """A schema registry that does not take the schema, or a message of another schema."""


_FATAL_TYPES = (
    RegistryRefusalError,
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
    31: "let this login write to the topic (brokers before 2.8 ask for IdempotentWrite on the"
    " cluster too)",
    33: "see security.mechanism",
    34: "this listener has no login; see security.protocol and the port",
    58: "see security.username and the variable of its password",
    76: "give another compression",
    35: "the broker is too old for idempotent producers; Kafka has them from 0.11 on",
}


#: What mends an authority without an extension that RFC 5280, section 4.2.1, asks for; what it has
#: signed stays valid.
_NEW_AUTHORITY = (
    "make the certificate of security.ca_file anew, with its key and name: openssl req -x509 -key"
    " CA.key -subj /CN=NAME -days 3650 -out CA.pem -addext basicConstraints=critical,CA:TRUE"
    " -addext keyUsage=critical,keyCertSign,cRLSign (Python 3.13 and later ask for these"
    " extensions)"
)

#: By OpenSSL's code of why a certificate is refused; else `ca_file` is not that of the broker's
#: certificate.
_CERTIFICATE_REMEDIES = {
    9: "the broker's certificate is not valid yet, or this clock is wrong",
    10: "renew the broker's certificate",
    62: "write a name of the certificate in bootstrap_servers",
    64: "write a name of the certificate in bootstrap_servers",
    79: _NEW_AUTHORITY,
    85: "sign the broker's certificate anew with authorityKeyIdentifier=keyid",
    86: _NEW_AUTHORITY,
    89: _NEW_AUTHORITY,
    92: _NEW_AUTHORITY,
}
#: First byte of what a listener with TLS answers to plain text (RFC 8446, section 5.1: an alert).
_TLS_ALERT = 21

#: The broker or the topic takes no batches of that size; it may take smaller ones.
TOO_LARGE = tuple(errors.for_code(code) for code in (10, 18))


class SmallerBatchesError(errors.KafkaError):  # type: ignore[misc]
    """A batch was too large; smaller ones follow."""


class TopicError(errors.KafkaError):  # type: ignore[misc]
    """A topic that takes no messages; the message says why."""

    def __str__(self) -> str:
        """Return the message alone."""
        return str(self.args[0])


class RegistryAwayError(TopicError):
    """A schema registry that may answer later; the message says why it does not."""


class TlsExpectedError(errors.KafkaError):  # type: ignore[misc]
    """The listener speaks TLS; plain text was sent."""


class NoTlsError(errors.KafkaError):  # type: ignore[misc]
    """The listener closes connections that begin with TLS."""


class ClosedError(errors.KafkaError):  # type: ignore[misc]
    """A broker answers and closes the connection at the next request."""


def cause_of(error: Exception, *, is_encrypted: bool) -> Exception:
    """Return why a connection could not be made: aiokafka has only that it is closed, and its
    cause.
    """
    cause = error.__cause__ if isinstance(error, errors.KafkaConnectionError) else None
    if isinstance(cause, ssl.SSLError):
        return cause
    if isinstance(cause, IncompleteReadError) and (cause.expected or 0) >> 24 == _TLS_ALERT:
        return TlsExpectedError()
    if is_encrypted and isinstance(error, ConnectionResetError):
        return NoTlsError()
    return error


def is_fatal(error: BaseException) -> bool:
    """Whether an error is permanent."""
    if isinstance(error, _FATAL_TYPES) or _is_client_refused(error):
        return True
    return getattr(error, "errno", None) in FATAL_CODES and _is_answer(error)


#: Messages by the types of errors: the first that fits.
_MESSAGES = (
    (
        TimeoutError | errors.RequestTimedOutError | errors.KafkaTimeoutError,
        "no answer from {servers} in time",
    ),
    (SmallerBatchesError, "{servers} refuses a batch as too large; sending smaller ones"),
    (
        TlsExpectedError,
        "{servers} speaks TLS; see security.protocol: SSL, or SASL_SSL with a login",
    ),
    (
        NoTlsError,
        "{servers} closes encrypted connections at their start; see security.protocol and the port",
    ),
    (
        ClosedError,
        (
            "{servers} answers and then closes the connection, perhaps for want of a login; see"
            " security.protocol"
        ),
    ),
    (
        errors.AuthenticationFailedError,
        "{servers} refuses the login; see security.username and the variable of its password",
    ),
    (
        errors.IncompatibleBrokerVersion | errors.UnrecognizedBrokerVersion,
        "{servers} does not know what the settings ask for, a login perhaps, or is too old",
    ),
    (
        OSError | errors.KafkaConnectionError | errors.NodeNotReadyError,
        "no broker answers at {servers}",
    ),
)


def words(error: BaseException, servers: str) -> str:
    """Return the message for an error, without secrets."""
    if isinstance(error, SinkError | TopicError):
        return str(error)
    if isinstance(error, ssl.SSLError):
        return _tls_words(error, servers)
    message = next((message for types, message in _MESSAGES if isinstance(error, types)), None)
    if message is not None:
        return message.format(servers=servers)
    if not _is_answer(error):
        return f"{servers}: {type(error).__name__}"
    code: int = getattr(error, "errno", -1)
    remedy = f"; {_REMEDIES[code]}" if code in _REMEDIES else ""
    return f"{servers} answers {type(error).__name__} (code {code}){remedy}"


def _tls_words(error: ssl.SSLError, servers: str) -> str:
    if _is_client_refused(error):
        return (
            f"{servers} refuses the client's certificate, or that there is none ({error.reason});"
            " see security.certificate_file and security.key_file"
        )
    if isinstance(error, ssl.SSLCertVerificationError):
        reason = error.verify_message.rstrip(".")
        remedy = _CERTIFICATE_REMEDIES.get(error.verify_code)
    else:
        reason = error.reason or "TLS fails"
        remedy = None
    return f"no encrypted connection to {servers}: {reason}; {remedy or 'see security.ca_file'}"


def _is_client_refused(error: BaseException) -> bool:
    """Whether an error is the broker's alert about the client's certificate (RFC 8446,
    section 6.2).
    """
    reason = (error.reason or "") if isinstance(error, ssl.SSLError) else ""
    return "_ALERT_" in reason and ("CERTIFICATE" in reason or "UNKNOWN_CA" in reason)


def _is_answer(error: BaseException) -> bool:
    return isinstance(error, errors.BrokerResponseError)
