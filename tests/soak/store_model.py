"""What a map of the store must look like, by what was acknowledged."""

import copy


class Refused(Exception):
    """The store must refuse this, with this problem's code."""


class MapModel:
    """One map that one client alone changes."""

    def __init__(self, name):
        self.name = name
        self.versions = {}  # name -> digest
        self.retired = {}  # of those that were removed
        self.active = self.previous = None
        self.revision = 0
        self.exists = False

    def add(self, version, digest):
        if {**self.retired, **self.versions}.get(version, digest) != digest:
            raise Refused("OtherDigest")
        self.versions[version] = digest
        self.exists = True

    def activate(self, version):
        if version not in self.versions:
            raise Refused("UnknownVersion")
        if version != self.active:
            self.previous, self.active = self.active, version
            self.revision += 1

    def roll_back(self):
        if self.previous is None:
            raise Refused("NoPrevious")
        self.previous, self.active = self.active, self.previous
        self.revision += 1

    def remove(self, version):
        if version not in self.versions:
            raise Refused("UnknownVersion")
        if version == self.active:
            raise Refused("VersionActive")
        self.retired[version] = self.versions.pop(version)
        if version == self.previous:
            self.previous = None

    def after(self, change):
        """@return a copy with the change (a name and arguments) made. Raises Refused."""
        result = copy.deepcopy(self)
        getattr(result, change[0])(*change[1:])
        return result

    def facts(self):
        if not self.exists:
            return None
        return {"versions": self.versions, "active": self.active, "previous": self.previous, "revision": self.revision}

    @staticmethod
    def facts_of(listed):
        """The same, of an answer of GET /v1/maps/{map}/versions."""
        return {"versions": {each["version"]: each["digest"] for each in listed["versions"]},
                "active": listed["version"], "previous": listed["previous_version"], "revision": listed["revision"]}
