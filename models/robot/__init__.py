"""One arm from its robot.yaml and its URDF (command `robot`).

In: robot.yaml with a URDF, xacro or SDF. Out: a `Robot`, and its parts in a MultibodyPlant.
Order: robot_config, truth_config (the file); urdf_document with sdf_document and xacro_*, urdf,
urdf_* (the description), effective_urdf; meshes (convex_hulls, collision_meshes, gltf); motors,
coupling; robot.
"""
