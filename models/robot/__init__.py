"""One arm from its robot.yaml and its URDF (command `robot`).

In: robot.yaml with a URDF, xacro or SDF. Out: a `Robot`, and its parts in a MultibodyPlant.
Order: robot_config, truth_config (the file); urdf_document with sdf_document, xacro_document and
xacro_expression; urdf (checks) with urdf_elements, urdf_shapes, urdf_pictures, mimic_joints,
rounded_angles, rotational_inertia; effective_urdf, drake_parsing; convex_hulls, collision_meshes
and gltf; motors, coupling; robot.
"""
