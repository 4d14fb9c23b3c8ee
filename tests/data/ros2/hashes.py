"""RIHS01 hashes of the message types that orenx speaks, from their definitions (REP-2016).

Run: python3 hashes.py. The hashes that are known from running systems are asserted."""

import hashlib
import json

IDS = {
    "int8": 2, "uint8": 3, "char": 3, "int32": 6, "uint32": 7, "int64": 8, "float32": 10, "float64": 11,
    "bool": 15, "string": 17,
}

DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec, uint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/msg/Time stamp, string frame_id",
    "std_msgs/msg/String": "string data",
    "geometry_msgs/msg/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/msg/Pose": "geometry_msgs/msg/Point position, geometry_msgs/msg/Quaternion orientation",
    "geometry_msgs/msg/PoseStamped": "std_msgs/msg/Header header, geometry_msgs/msg/Pose pose",
    "geometry_msgs/msg/Transform": "geometry_msgs/msg/Vector3 translation, geometry_msgs/msg/Quaternion rotation",
    "geometry_msgs/msg/TransformStamped": "std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/Transform transform",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/msg/TransformStamped[] transforms",
    "sensor_msgs/msg/Image": "std_msgs/msg/Header header, uint32 height, uint32 width, string encoding, uint8 is_bigendian, uint32 step, uint8[] data",
    "sensor_msgs/msg/CompressedImage": "std_msgs/msg/Header header, string format, uint8[] data",
    "sensor_msgs/msg/RegionOfInterest": "uint32 x_offset, uint32 y_offset, uint32 height, uint32 width, bool do_rectify",
    "sensor_msgs/msg/CameraInfo": "std_msgs/msg/Header header, uint32 height, uint32 width, string distortion_model, float64[] d, float64[9] k, float64[9] r, float64[12] p, uint32 binning_x, uint32 binning_y, sensor_msgs/msg/RegionOfInterest roi",
    "sensor_msgs/msg/PointField": "string name, uint32 offset, uint8 datatype, uint32 count",
    "sensor_msgs/msg/PointCloud2": "std_msgs/msg/Header header, uint32 height, uint32 width, sensor_msgs/msg/PointField[] fields, bool is_bigendian, uint32 point_step, uint32 row_step, uint8[] data, bool is_dense",
    "nav_msgs/msg/MapMetaData": "builtin_interfaces/msg/Time map_load_time, float32 resolution, uint32 width, uint32 height, geometry_msgs/msg/Pose origin",
    "nav_msgs/msg/OccupancyGrid": "std_msgs/msg/Header header, nav_msgs/msg/MapMetaData info, int8[] data",
    "nvblox_msgs/msg/DistanceMapSlice": "std_msgs/msg/Header header, float32 resolution, uint32 width, uint32 height, geometry_msgs/msg/Point origin, float32 unknown_value, float32[] data",
}

# Of the parts of services.
DEFINITIONS |= {
    "service_msgs/msg/ServiceEventInfo": "uint8 event_type, builtin_interfaces/msg/Time stamp, char[16] client_gid, int64 sequence_number",
    "std_msgs/msg/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/msg/MultiArrayDimension[] dim, uint32 data_offset",
    "std_msgs/msg/Float32MultiArray": "std_msgs/msg/MultiArrayLayout layout, float32[] data",
}

# Requests and responses.
SERVICES = {
    "example_interfaces/srv/AddTwoInts": ("int64 a, int64 b", "int64 sum"),
    "nvblox_msgs/srv/EsdfAndGradients": (
        "bool update_esdf, bool visualize_esdf, bool use_aabb, string frame_id, "
        "geometry_msgs/msg/Point aabb_min_m, geometry_msgs/msg/Vector3 aabb_size_m, "
        "geometry_msgs/msg/Point[] aabbs_to_clear_min_m, geometry_msgs/msg/Vector3[] aabbs_to_clear_size_m, "
        "geometry_msgs/msg/Point[] spheres_to_clear_center_m, float32[] spheres_to_clear_radius_m",
        "std_msgs/msg/Header header, geometry_msgs/msg/Point origin_m, float32 voxel_size_m, "
        "std_msgs/msg/Float32MultiArray esdf_and_gradients, bool success",
    ),
}

for service, (request, response) in SERVICES.items():
    DEFINITIONS |= {
        f"{service}_Request": request,
        f"{service}_Response": response,
        f"{service}_Event": f"service_msgs/msg/ServiceEventInfo info, {service}_Request[<=1] request, {service}_Response[<=1] response",
        service: f"{service}_Request request_message, {service}_Response response_message, {service}_Event event_message",
    }

# From running systems.
KNOWN = {
    "example_interfaces/srv/AddTwoInts": "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
}


def field(text):
    kind, name = text.split()
    offset, capacity = 0, 0
    if kind.endswith("]"):
        kind, _, size = kind[:-1].partition("[")
        if size.startswith("<="):
            offset, capacity = 96, int(size[2:])
        else:
            offset, capacity = (48, int(size)) if size else (144, 0)
    nested = kind if "/" in kind else ""
    return {
        "name": name,
        "type": {
            "type_id": (1 if nested else IDS[kind]) + offset,
            "capacity": capacity,
            "string_capacity": 0,
            "nested_type_name": nested,
        },
    }


def describe(name):
    return {"type_name": name, "fields": [field(text) for text in DEFINITIONS[name].split(", ")]}


def referenced(name, found):
    for part in describe(name)["fields"]:
        other = part["type"]["nested_type_name"]
        if other and other not in found:
            found.add(other)
            referenced(other, found)
    return found


def rihs01(name):
    whole = {
        "type_description": describe(name),
        "referenced_type_descriptions": [describe(n) for n in sorted(referenced(name, set()))],
    }
    text = json.dumps(whole, ensure_ascii=True, separators=(", ", ": "), sort_keys=False)
    return hashlib.sha256(text.encode()).hexdigest()


for name, digest in KNOWN.items():
    assert rihs01(name) == digest, name

if __name__ == "__main__":
    for name in DEFINITIONS:
        print(name, "RIHS01_" + rihs01(name))
