"""Encrypted sessions, and who is kept out by what."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from soter.adapters.zenoh.session import SessionOptions, TlsOptions, endpoints, open_session
from soter.errors import RobotUnavailable
from soter.problems import config_error, pydantic_problems
from tests.adapters.zenoh.sessions import SILENCE_S, Authority, Heard, client, opened, router

HERE = "127.0.0.1"


@pytest.fixture
def ours(tmp_path: Path) -> Authority:
    return Authority(tmp_path / "ours")


@pytest.fixture
def theirs(tmp_path: Path) -> Authority:
    return Authority(tmp_path / "theirs")


def why_refused(where: list[str], tls: TlsOptions) -> str:
    with pytest.raises(RobotUnavailable) as found:
        open_session(client(where, tls=tls, open_timeout_s=0.3))
    return str(found.value)


def test_clients_meet_with_certificates(ours: Authority) -> None:
    with router(listen=[f"tls/{HERE}:0"], tls=ours.tls(HERE)) as where:
        assert where[0].startswith(f"tls/{HERE}:")
        with opened(client(where, tls=ours.tls("alpha")), client(where, tls=ours.tls("beta"))) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")
            assert {link.dst.partition("/")[0] for link in alpha.info.links()} == {"tls"}


def test_peers_meet_with_certificates(ours: Authority) -> None:
    tls = ours.tls(HERE)
    with opened(SessionOptions(tls=tls)) as (alpha,):
        where = endpoints(alpha)
        assert [each.partition("/")[0] for each in where] == ["tls"]
        with opened(SessionOptions(tls=tls, connect=tuple(where))) as (beta,):
            assert Heard(alpha, "a").hears(beta, "a")


def test_one_sided_tls_proves_the_router_only(ours: Authority, theirs: Authority) -> None:
    with router(listen=[f"tls/{HERE}:0"], tls=ours.tls(HERE, mutual=False)) as where:
        with opened(client(where, tls=ours.tls()), client(where, tls=ours.tls())) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")
        assert "its certificate is not believed (unable to get local issuer certificate)" in why_refused(
            where, theirs.tls()
        )


def test_whoever_has_no_certificate_of_ours_gets_nothing_across(ours: Authority, theirs: Authority) -> None:
    with ExitStack() as stack:
        where = stack.enter_context(router(listen=[f"tls/{HERE}:0"], tls=ours.tls(HERE)))
        (alpha,) = stack.enter_context(opened(client(where, tls=ours.tls("alpha"))))
        heard = Heard(alpha, "**")
        assert "it wants tls.certificate of an authority that it knows" in why_refused(where, ours.tls())
        forged = theirs.tls("alpha", root=ours.root)
        assert "it wants tls.certificate of an authority that it knows" in why_refused(where, forged)
        plain = where[0].replace("tls/", "tcp/")
        with pytest.raises(RobotUnavailable, match="refuses the session"):
            open_session(client([plain], open_timeout_s=0.3))
        # Those who do not give up, and publish all the time.
        tries: list[dict[str, Any]] = [
            {"tls": ours.tls(), "connect": where},
            {"tls": forged, "connect": where},
            {"connect": [plain]},
        ]
        with opened(*(SessionOptions(**each) for each in tries)) as strangers:
            until_s = time.monotonic() + 2 * SILENCE_S
            while time.monotonic() < until_s:
                for stranger in strangers:
                    stranger.put("robot1/cmd_vel", b"go")
                time.sleep(0.01)
            assert all(not each.info.links() for each in strangers)
        assert heard == []
        with opened(client(where, tls=ours.tls("beta"))) as (beta,):
            assert heard.hears(beta, "robot1/cmd_vel")


def test_a_router_must_be_who_it_is_said_to_be(ours: Authority) -> None:
    with router(listen=[f"tls/{HERE}:0"], tls=ours.tls("elsewhere.test")) as where:
        assert "its certificate is not believed (IP address mismatch" in why_refused(where, ours.tls("alpha"))
        unnamed = ours.tls("alpha", verify_name=False)
        with opened(client(where, tls=unnamed), client(where, tls=unnamed)) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")


def test_without_a_certificate_of_its_own_a_peer_listens_nowhere(ours: Authority) -> None:
    assert SessionOptions(tls=ours.tls()).listens_at == ()
    assert SessionOptions(tls=ours.tls(HERE)).listens_at == (f"tls/{HERE}:0",)


def test_what_is_wrong_with_files_is_said_before_anything_opens(tmp_path: Path, ours: Authority) -> None:
    own, other, empty = ours.tls("alpha"), ours.tls("beta"), tmp_path / "empty"
    empty.touch()

    def refusal(**tls: Any) -> str:
        with pytest.raises(ValidationError) as found:
            SessionOptions(tls={"root_ca": ours.root} | tls)
        return str(config_error(pydantic_problems(found.value, SessionOptions), None))

    assert "tls.root_ca: it is '/no/ca', allowed: a file that can be read (No such file" in refusal(
        root_ca="/no/ca", mutual=False
    )
    assert "allowed: certificates in PEM" in refusal(root_ca=empty, mutual=False)
    assert "tls.mutual: it is True, allowed: false without a certificate, or true with one" in refusal()
    assert "tls.private_key: it is None, allowed: the private key of the certificate" in refusal(
        certificate=own.certificate
    )
    assert "allowed: none without a certificate" in refusal(private_key=own.private_key, mutual=False)
    assert "tls.certificate: it is '/no/cert', allowed: a file that can be read" in refusal(
        certificate="/no/cert", private_key=own.private_key
    )
    assert "allowed: the private key of certificate" in refusal(
        certificate=own.certificate, private_key=other.private_key
    )
    assert "allowed: the private key of certificate" in refusal(certificate=empty, private_key=own.private_key)
    assert "tls.certificat: unknown key, did you mean 'certificate'?" in refusal(certificat="x", mutual=False)


def test_beside_encrypted_links_there_are_no_others(ours: Authority) -> None:
    for key in ("listen", "connect"):
        with pytest.raises(ValidationError, match="allowed: tls/… where there is a table 'tls'"):
            SessionOptions(tls=ours.tls(HERE), **{key: ("tcp/127.0.0.1:7447",)})
    with pytest.raises(ValidationError, match=r"allowed: tls/… with tls\.certificate and tls\.private_key"):
        SessionOptions(tls=ours.tls(), listen=("tls/127.0.0.1:7447",))
    far = SessionOptions(tls=ours.tls(), connect=("tls/robot1.example.org:7447",))
    assert far.listens_at == ()
