"""One arm from its robot.yaml and its URDF (command `robot`).

In: robot.yaml with a URDF, SDF or MJCF. Out: a `Robot`, and its parts in a MultibodyPlant.
Order: robot_config, truth_config (the file); limited_child, ros_packages, xacro_document with its
xacro_child, drake_document with its drake_child, urdf_document; arm_structure (which joints are the
arm's); urdf (checks) with urdf_elements, urdf_shapes, urdf_pictures, mimic_joints, rounded_angles,
rotational_inertia; effective_urdf, drake_parsing; convex_hulls, collision_meshes and gltf; motors,
coupling; robot; unit_doubts.
"""
