"""Robot descriptions in users' forms, read and written: URDF, joint origins, tables; plug-ins bring further forms."""
