"""Enrolment codes: reused, late, guessed, for another authority or robot."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from datetime import UTC, datetime

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.errors import TwinError
from tsd_twin.messages.signatures import canonical, tag, with_signature
from tsd_twin.security import BusIdentity, Role
from tsd_twin.security.certificates import (
    CertificateAuthority,
    PublicKey,
    certificate_pem,
    identity_of,
    new_key,
)
from tsd_twin.security.enrolment import (
    VALID_S,
    EnrolmentCode,
    EnrolmentError,
    Enrolments,
    Joined,
    JoinRequest,
    Refusal,
    requested_key,
    seal,
    signing_request,
    unseal,
)

NOW = datetime.now(UTC)
AUTHORITY = CertificateAuthority.new(new_key(), NOW)
OTHER_AUTHORITY = CertificateAuthority.new(new_key(), NOW)
CODE = EnrolmentCode.new(AUTHORITY.certificate)
SEALING = {"lab1": CODE.key(AUTHORITY.certificate), "lab2": secrets.token_bytes(32)}
CSRS = [signing_request(new_key()) for _ in range(3)]
FREE = 5
"""Attempts of an address before it must wait."""


class Gateway:
    """Enrolment of two robots, which records the certificates it signs."""

    def __init__(self) -> None:
        self.issued: list[tuple[str, PublicKey]] = []
        self.enrolments = Enrolments(self._issue)
        for robot, key in SEALING.items():
            self.enrolments.offer(robot, key, 0.0)

    def _issue(self, robot: str, key: PublicKey) -> Joined:
        self.issued.append((robot, key))
        certificate = AUTHORITY.issue_client(key, BusIdentity(robot, Role.ROBOT), NOW, 30)
        return Joined(robot, certificate_pem(certificate), "{}", "{}")

    def ask(self, message: bytes, now_s: float, address: str = "a") -> bytes | Refusal:
        try:
            return self.enrolments.answer(message, address, now_s)
        except EnrolmentError as refused:
            return refused.refusal


@given(st.text("0123456789ABCDEFGHJKMNPQRSTVWXYZ", min_size=10, max_size=10))
def test_a_typed_code_is_the_printed_one(secret: str) -> None:
    code = EnrolmentCode(secret, CODE.fingerprint)
    assert len(code.text.replace("-", "")) == 16
    assert code.secret not in repr(code)
    typed = code.text.lower().replace("-", " ").replace("0", "o").replace("1", "l")
    assert EnrolmentCode.parse(typed) == code


@pytest.mark.parametrize(
    "text", ["", "7K3M", "7K3M-9Q2X-HT4W-0B8U", "7K3M-9Q2X-HT4W-0B8N-1", "é" * 16]
)
def test_other_text_is_not_a_code(text: str) -> None:
    with pytest.raises(TwinError, match="16 digits and letters"):
        EnrolmentCode.parse(text)


def test_codes_use_all_fifty_bits() -> None:
    codes = [EnrolmentCode.new(AUTHORITY.certificate).secret for _ in range(500)]
    assert len(set(codes)) == len(codes)
    assert all(len(set(column)) == 32 for column in zip(*codes, strict=True))


def test_another_authority_derives_another_key_even_with_the_same_fingerprint() -> None:
    theirs = CODE.key(OTHER_AUTHORITY.certificate)
    request = seal(SEALING["lab1"], JoinRequest(CSRS[0]))
    with pytest.raises(InvalidSignature):
        unseal(theirs, request, JoinRequest)
    forged = seal(theirs, Joined("lab1", "", "{}", "{}"), request)
    with pytest.raises(InvalidSignature):
        unseal(SEALING["lab1"], forged, Joined, request)


@dataclass(frozen=True)
class Try:
    code: str | None
    csr: int
    robot: str | None
    is_done: bool
    address: str
    pause_s: float


TRIES = st.builds(
    Try,
    code=st.sampled_from(["lab1", "lab1", "lab2", None]),
    csr=st.integers(0, len(CSRS) - 1),
    robot=st.sampled_from([None, None, "lab1", "lab2"]),
    is_done=st.sampled_from([False, False, True]),
    address=st.sampled_from("abc"),
    pause_s=st.sampled_from([0.0, 0.1, 30.0, 200.0]),
)


def expected(each: Try, now_s: float, used: dict[str, int], done: set[str]) -> Refusal | None:
    """Return the refusal of an attempt without waiting times, or None if it is answered."""
    if each.code is None:
        return Refusal.WRONG
    if now_s >= VALID_S:
        return Refusal.LATE
    if each.robot not in (None, each.code):
        return Refusal.OTHER_ROBOT
    if each.code in done or used.get(each.code, each.csr) != each.csr:
        return Refusal.USED
    return None


@given(st.lists(TRIES, max_size=40))
def test_each_code_gives_one_key_one_certificate_in_time(tries: list[Try]) -> None:
    gateway, now_s = Gateway(), 0.0
    used: dict[str, int] = {}
    done, failed = set[str](), dict.fromkeys("abc", 0)
    for each in tries:
        now_s += each.pause_s
        key = SEALING[each.code] if each.code else secrets.token_bytes(32)
        message = seal(key, JoinRequest(CSRS[each.csr], each.robot, each.is_done))
        answer = gateway.ask(message, now_s, each.address)
        if answer is Refusal.WAIT:
            assert failed[each.address] >= FREE
            continue
        refusal = expected(each, now_s, used, done)
        if refusal is not None:
            assert answer is refusal
            failed[each.address] += 1
            continue
        assert each.code is not None
        assert isinstance(answer, bytes)
        joined = unseal(key, answer, Joined, message)
        certificate = x509.load_pem_x509_certificate(joined.certificate.encode())
        assert identity_of(certificate) == BusIdentity(each.code, Role.ROBOT)
        assert certificate.public_key() == requested_key(CSRS[each.csr])
        used[each.code] = each.csr
        done |= {each.code} if each.is_done else set()
    assert gateway.issued == [(code, requested_key(CSRS[csr])) for code, csr in used.items()]
    still = [robot for robot in SEALING if robot not in done and now_s < VALID_S]
    assert gateway.enrolments.open_robots(now_s) == still
    assert gateway.enrolments.missing == [robot for robot in SEALING if robot not in done]


@pytest.mark.parametrize("addresses", [1, 100, 10_000])
def test_guessing_ten_thousand_times_gives_nothing(addresses: int) -> None:
    gateway, checked = Gateway(), 0
    for number in range(10_000):
        guess = seal(secrets.token_bytes(32), JoinRequest(CSRS[0], "lab1"))
        now_s = number * VALID_S / 10_000
        checked += gateway.ask(guess, now_s, f"x{number % addresses}") is not Refusal.WAIT
    assert gateway.issued == []
    assert checked <= (FREE + 7 if addresses == 1 else 60 + VALID_S / 5.0)
    if addresses == 1:  # The holder of the code has another address, and does not wait.
        right = seal(SEALING["lab1"], JoinRequest(CSRS[1]))
        assert gateway.ask(right, VALID_S - 1.0, "robot") is not Refusal.WAIT
        assert [robot for robot, _ in gateway.issued] == ["lab1"]


def test_guessing_right_while_waiting_is_not_noticed() -> None:
    gateway = Gateway()
    for _ in range(FREE):
        gateway.ask(seal(secrets.token_bytes(32), JoinRequest(CSRS[0])), 0.0)
    right = seal(SEALING["lab1"], JoinRequest(CSRS[0]))
    assert gateway.ask(right, 0.0) is Refusal.WAIT
    assert gateway.issued == []
    assert isinstance(gateway.ask(right, 6.0), bytes)


@given(st.data())
def test_a_changed_request_is_refused(data: st.DataObject) -> None:
    gateway = Gateway()
    message = bytearray(seal(SEALING["lab1"], JoinRequest(CSRS[0], "lab1")))
    place = data.draw(st.integers(0, len(message) - 1))
    message[place] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.sampled_from([len(message), place]))
    content = bytes(message[:cut])
    if content.lower() == seal(SEALING["lab1"], JoinRequest(CSRS[0], "lab1")).lower():
        return  # Another case of a hexadecimal digit.
    assert gateway.ask(content, 0.0) is Refusal.WRONG
    assert gateway.issued == []


def test_a_reply_is_for_one_request() -> None:
    gateway = Gateway()
    first, second = (seal(SEALING["lab1"], JoinRequest(CSRS[0], each)) for each in (None, "lab1"))
    answer = gateway.ask(first, 0.0)
    assert isinstance(answer, bytes)
    with pytest.raises(InvalidSignature):
        unseal(SEALING["lab1"], answer, Joined, second)
    assert gateway.ask(answer, 0.0) is Refusal.WRONG  # Reflected.


def test_the_same_request_is_answered_again_until_it_is_confirmed() -> None:
    gateway = Gateway()
    message = seal(SEALING["lab1"], JoinRequest(CSRS[0]))
    answers = [gateway.ask(message, second) for second in (0.0, 1.0, VALID_S - 0.1)]
    assert len(set(answers)) == 1
    done = seal(SEALING["lab1"], JoinRequest(CSRS[0], is_done=True))
    assert isinstance(gateway.ask(done, VALID_S - 0.1), bytes)
    assert gateway.ask(message, VALID_S - 0.1) is Refusal.USED
    assert len(gateway.issued) == 1


def test_a_code_is_not_spent_when_the_authority_fails() -> None:
    fails = [True]

    def issue(robot: str, _key: PublicKey) -> Joined:
        if fails:
            raise TwinError("no space left")
        return Joined(robot, "", "", "")

    enrolments = Enrolments(issue)
    enrolments.offer("lab1", SEALING["lab1"], 0.0)
    first, second = (seal(SEALING["lab1"], JoinRequest(csr)) for csr in CSRS[:2])
    with pytest.raises(TwinError, match="no space"):
        enrolments.answer(first, "a", 0.0)
    fails.clear()
    assert enrolments.answer(second, "a", 0.0)


def greedy_request(key: ec.EllipticCurvePrivateKey) -> str:
    """Return a request for the rights of another robot."""
    units = [(NameOID.ORGANIZATIONAL_UNIT_NAME, "operator"), (NameOID.COMMON_NAME, "alice")]
    name = x509.Name([x509.NameAttribute(*unit) for unit in units])
    usages = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.ANY_EXTENDED_KEY_USAGE]
    builder = (
        x509.CertificateSigningRequestBuilder()
        .subject_name(name)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("lab.example")]), critical=False)
    )
    request = builder.sign(key, hashes.SHA256())
    return request.public_bytes(serialization.Encoding.PEM).decode()


def test_a_request_for_more_gets_the_reserved_name_and_role() -> None:
    gateway, key = Gateway(), new_key()
    message = seal(SEALING["lab1"], JoinRequest(greedy_request(key)))
    answer = gateway.ask(message, 0.0)
    assert isinstance(answer, bytes)
    joined = unseal(SEALING["lab1"], answer, Joined, message)
    made = x509.load_pem_x509_certificate(joined.certificate.encode())
    plain = AUTHORITY.issue_client(key, BusIdentity("lab1", Role.ROBOT), NOW, 30)
    assert made.subject == plain.subject
    assert list(made.extensions) == list(plain.extensions)


def malformed() -> list[str]:
    """Return requests without proof of a private key, or with a key of another kind."""
    builder = x509.CertificateSigningRequestBuilder().subject_name(x509.Name([]))
    p384 = builder.sign(ec.generate_private_key(ec.SECP384R1()), hashes.SHA256())
    edwards = builder.sign(ed25519.Ed25519PrivateKey.generate(), None)
    first, second = (x509.load_pem_x509_csr(csr.encode()) for csr in CSRS[:2])
    swapped = first.public_bytes(serialization.Encoding.DER).replace(
        first.public_key().public_bytes(
            serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
        ),
        second.public_key().public_bytes(
            serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
        ),
    )
    stolen = x509.load_der_x509_csr(swapped)
    pem = [
        each.public_bytes(serialization.Encoding.PEM).decode() for each in (p384, edwards, stolen)
    ]
    return ["", "nothing", *pem]


@pytest.mark.parametrize("number", range(5))
def test_a_request_without_a_proven_key_is_refused(number: int) -> None:
    gateway = Gateway()
    message = seal(SEALING["lab1"], JoinRequest(malformed()[number]))
    assert gateway.ask(message, 0.0) is Refusal.MALFORMED
    assert gateway.issued == []


@pytest.mark.parametrize("body", [b'{"a":1', b'{"csr":1', b'{"csr":"","more":1', b"[1"])
def test_a_message_of_another_form_is_refused(body: bytes) -> None:
    content = body + b"}"
    message = with_signature(content, tag(SEALING["lab1"], canonical(b"join", b"", content)).hex())
    assert Gateway().ask(message, 0.0) is Refusal.MALFORMED


def test_refusals_have_sentences_that_differ() -> None:
    texts = {str(EnrolmentError(each, 3)) for each in Refusal}
    assert len(texts) == len(Refusal)
