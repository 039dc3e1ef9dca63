"""Settings of `pumps simulate-cloth`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

from stages.shared.contract import OFTEN, SeededConfig, WritingConfig


class Config(WritingConfig, SeededConfig):
    """Simulate a sheet of cloth that hangs from two random vertices, many times."""

    output: Path = Field(description="Folder of the mesh artefact.")
    count: int = Field(100, json_schema_extra=OFTEN, description="Simulations.", ge=1)
    seconds: float = Field(2.0, json_schema_extra=OFTEN, description="Length of a simulation.", gt=0, le=60)
    fps: float = Field(25.0, description="Frames per second that are stored.", gt=0, le=240)
    rows: int = Field(22, description="Vertices along a side; 22 make the paper's 484.", ge=3, le=100)
    size_m: float = Field(1.0, description="Length of a side, about, in metres.", gt=0)
    steps_per_second: int = Field(2000, description="Steps of the solver in a second.", ge=100)
    iterations: int = Field(8, description="Passes over the stretch constraints in a step.", ge=1)
    thickness_m: float = Field(0.02, description="Least distance of vertices without an edge, in metres.", gt=0)
    test_share: float = Field(0.2, description="Share of the simulations in the split `test`.", ge=0, le=1)
    val_share: float = Field(0.05, description="Share of the simulations in the split `val`.", ge=0, le=1)
    batch: int = Field(32, description="Simulations that are computed at once.", ge=1)
    workers: int = Field(1, json_schema_extra=OFTEN, description="Processes that simulate.", ge=1)

    @model_validator(mode="after")
    def _fits(self) -> Config:
        if self.test_share + self.val_share > 1:
            raise ValueError("test_share and val_share must not exceed 1 together")
        if self.seconds * self.fps < 1 - 1e-6:
            raise ValueError("seconds must be at least one frame, 1 / fps")
        if self.thickness_m > 0.45 * self.size_m / (self.rows - 1):
            raise ValueError(
                f"thickness_m ({self.thickness_m:g}) must be at most 0.45 of the vertices' spacing "
                f"({self.size_m / (self.rows - 1):.4f}); the sheet would touch itself at rest"
            )
        return self
