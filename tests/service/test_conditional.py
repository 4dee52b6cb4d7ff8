"""ETags: what has not changed is not sent again, and nothing is deleted unseen."""

import httpx

from tests.support.small_job import TIF


def _made(client: httpx.Client) -> str:
    place: str = client.post("/v1/influences", params={"formula": TIF}).json()["links"]["self"]
    return place


def test_what_has_not_changed_is_not_sent_again(client: httpx.Client) -> None:
    place = _made(client)
    first = client.get(place)
    again = client.get(place, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
    assert client.get(place, headers={"If-None-Match": '"other"'}).json() == first.json()
    listed = client.get("/v1/influences")
    _made(client)
    assert client.get("/v1/influences", headers={"If-None-Match": listed.headers["etag"]}).status_code == 200


def test_a_file_is_not_sent_again_either(client: httpx.Client) -> None:
    first = client.get("/docs")
    again = client.get("/docs", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_nothing_is_deleted_unseen(client: httpx.Client) -> None:
    place = _made(client)
    refusal = client.delete(place, headers={"If-Match": '"what was read long ago"'})
    assert (refusal.status_code, refusal.json()["code"]) == (412, "changed")
    tag = client.get(place).headers["etag"]
    assert client.delete(place, headers={"If-Match": f'"other", {tag}'}).status_code == 204
    assert client.delete(place, headers={"If-Match": tag}).status_code == 404
