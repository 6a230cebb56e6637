"""Plug-ins: what a user brings from a file of their own, named ``package.module:Name`` in a setting.

Modules are looked for where Python looks, then in the folders of `search_path.look_in`, which processes started from
here know, too. What goes wrong in a plug-in is a `PluginError`: one line with the setting, the plug-in, the place and
the fix. The entry is :mod:`envs.plug_ins.lookup`.
"""
